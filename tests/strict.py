"""What tests hold every call of the package to: arguments and results fit their annotations, shapes included."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Self, TypeVar, Union, get_args, get_origin

import numpy as np
from beartype import BeartypeConf, beartype
from beartype.roar import BeartypeDecorHintException

F = TypeVar("F", bound=Callable[..., Any])

PACKAGES = tuple(
    f"cableway.{name}"
    for name in (
        "control",
        "estimation",
        "geometry",
        "motion",
        "rendering",
        "rod",
        "scene",
        "tang2025.models",
        "tracking",
        "verification",
    )
)
"""Where calls are checked."""

CONF = BeartypeConf(is_pep484_tower=True)
"""An int is a float, as for every static type checker."""

JAX = {"JAX_NUMPY_RANK_PROMOTION": "raise", "JAX_NUMPY_DTYPE_PROMOTION": "strict"}
"""Settings of the environment under which JAX broadcasts no axes and mixes no types by itself, in subprocesses too."""

READ_INPUT = "cableway.scene."
"""Where records are made of what users wrote, which they refuse or convert in their own words."""


def typechecker(function: F) -> F:
    """Beartype for one function, with hints as they are meant at run time."""
    if function.__module__.startswith(READ_INPUT) and function.__name__ == "__init__":
        return function
    function.__annotations__.update({name: _meant(hint) for name, hint in function.__annotations__.items()})
    try:
        return beartype(function, conf=CONF)
    except BeartypeDecorHintException:
        return function


def _meant(hint: Any) -> Any:
    """NumPy's scalars are arrays without axes, JAX takes its arrays; `Self` and static protocols mean nothing here."""
    if getattr(hint, "array_type", np.ndarray) is not np.ndarray:
        return Union[hint, hint.dtype[np.ndarray, hint.dim_str]]  # noqa: UP007 - jaxtyping's classes have no |
    if getattr(hint, "dim_str", "") == "...":
        return Union[hint, np.floating]  # noqa: UP007
    if get_origin(hint) is tuple:
        return tuple[tuple(map(_meant, get_args(hint)))]
    return Any if any(map(_is_static, (hint, *get_args(hint)))) else hint


def _is_static(hint: Any) -> bool:
    return hint is Self or (getattr(hint, "_is_protocol", False) and not getattr(hint, "_is_runtime_protocol", False))
