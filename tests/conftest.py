"""Strict tests: see `strict`. Here, so that it is in force before any test imports the package."""

from __future__ import annotations

import os
from collections.abc import Iterator

import jaxtyping
import pytest
import strict

os.environ |= strict.JAX
strict.install()


@pytest.fixture(autouse=True)
def _wrong_types(request: pytest.FixtureRequest) -> Iterator[None]:
    """Nothing is checked in tests marked `wrong_types`."""
    jaxtyping.config.update("jaxtyping_disable", request.node.get_closest_marker("wrong_types") is not None)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)
