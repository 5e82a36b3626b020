"""The directives `api` and `docstrings`: what docstrings say of names below `cableway.`, one a line."""

from __future__ import annotations

import inspect
from importlib import import_module

from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList
from sphinx.application import Sphinx


def resolved(name: str) -> object:
    """What stands under a dotted name below `cableway.`."""
    module, found = "cableway", import_module("cableway")
    for part in name.split("."):
        module = f"{module}.{part}"
        found = getattr(found, part) if hasattr(found, part) else import_module(module)
    return found


def directive(name: str) -> str:
    """The directive of `sphinx.ext.autodoc` for it."""
    found = resolved(name)
    if inspect.isclass(found):
        return "autoexception" if issubclass(found, BaseException) else "autoclass"
    return "autofunction" if inspect.isroutine(found) else "automodule" if inspect.ismodule(found) else "autodata"


class Api(Directive):
    """A line is a name and options of autodoc, as in `robot.ur.URRobot members=connect,close`."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Everything in the order of the lines."""
        lines = ["```{eval-rst}"]
        for name, *options in map(str.split, self.content):
            lines.append(f".. {directive(name)}:: cableway.{name}")
            lines += [f"   :{key}: {value}" for key, _, value in (each.partition("=") for each in options)]
        group = nodes.container()
        self.state.nested_parse(StringList([*lines, "```"], self.content[0]), self.content_offset, group)
        return [*group.children]


class Docstrings(Directive):
    """A line is a module, whose docstring is shown as it stands, formulas in plain text."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """A section for each line."""
        return [self._section(name) for name in self.content]

    def _section(self, name: str) -> nodes.section:
        text = inspect.getdoc(resolved(name)) or ""
        section = nodes.section(ids=[nodes.make_id(name)], names=[name])
        section += [nodes.title("", name), nodes.literal_block(text, text, language="text")]
        return section


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_directive("api", Api)
    app.add_directive("docstrings", Docstrings)
    return {"parallel_read_safe": True}
