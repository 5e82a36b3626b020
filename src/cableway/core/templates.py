"""Documents made from templates in the packages."""

from __future__ import annotations

from typing import Any

import jinja2


def render(template: str, *packages: str, **values: Any) -> str:
    """A template filled in, escaped where it is HTML; it and those that it includes are looked for in `packages`."""
    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader(name, "") for name in packages]),
        autoescape=jinja2.select_autoescape(enabled_extensions=("html.jinja",)),
        undefined=jinja2.StrictUndefined,
    )
    return environment.get_template(template).render(**values)
