"""What tests hold every call of the package to: arguments and results fit their annotations, shapes included.

Whether they fit depends on types, dtypes and shapes, and where an annotation names values, on these. So calls that are
alike in all that are checked once: a check takes some 100 us, looking up that it was made some 5 us.
"""

from __future__ import annotations

import ast
import inspect
import sys
import threading
from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from functools import wraps
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from types import CodeType, FunctionType, ModuleType, SimpleNamespace
from typing import Any, Literal, Self, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from beartype import BeartypeConf, beartype
from beartype.roar import BeartypeDecorHintException
from jaxtyping import config, jaxtyped

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

MOST_REMEMBERED = 10_000
"""Kinds of calls that are remembered of one function."""

_GIVEN = threading.local()


def install() -> None:
    """Check every call of `PACKAGES`, which are not yet imported."""
    sys.meta_path.insert(0, _Finder())


class _Finder(MetaPathFinder):
    """Finds the modules of `PACKAGES`."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        if not name.startswith(tuple(f"{each}." for each in PACKAGES)) and name not in PACKAGES:
            return None
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _Loader(spec.loader.name, spec.loader.path)
        return spec


class _Loader(SourceFileLoader):
    """Decorates every function and class with `strictly`, functions before and classes after all other decorators.

    As the hook of jaxtyping does, which however has all that is imported meanwhile, JAX too, compiled anew.
    """

    def path_stats(self, path: str) -> Mapping[str, Any]:
        raise OSError("its bytecode is neither read nor written")

    def source_to_code(self, data: Any, path: Any, *, _optimize: int = -1) -> CodeType:
        tree = ast.parse(data)
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                place = len(node.decorator_list) if isinstance(node, ast.FunctionDef) else 0
                node.decorator_list.insert(place, ast.copy_location(ast.Name("__strictly__", ast.Load()), node))
        return compile(tree, path, "exec", dont_inherit=True, optimize=_optimize)

    def exec_module(self, module: ModuleType) -> None:
        vars(module)["__strictly__"] = strictly
        super().exec_module(module)


def strictly(made: Any) -> Any:
    """A function whose calls are checked, or a class; of dataclasses the initialiser is checked too."""
    if isinstance(made, FunctionType):
        return _remembering(made)
    initialiser = made.__init__ if hasattr(made, "__dataclass_fields__") else None
    if (
        isinstance(initialiser, FunctionType) and initialiser.__globals__ is not globals()
    ):  # else inherited, and checked
        made.__init__ = _remembering(initialiser)
    return made


def typechecker(function: F) -> F:
    """Beartype for one function, with hints as they are meant at run time."""
    if function.__module__.startswith(READ_INPUT) and function.__name__ == "__init__":
        return function
    function.__annotations__.update({name: _meant(hint) for name, hint in function.__annotations__.items()})
    try:
        return beartype(function, conf=CONF)
    except BeartypeDecorHintException:
        return function


def _remembering(function: F) -> F:
    """The function; its arguments and results are checked, but not where a call of the kind fitted before."""
    if function.__module__.startswith(READ_INPUT) and function.__name__ == "__init__":
        return function
    fitting = _FITTING.setdefault(function.__code__, {})  # pyright: ignore[reportFunctionMemberAccess]
    made: list[Any] = []

    def careful(*args: Any, **kwargs: Any) -> Any:
        if not made:  # on the first call, so that importing costs nothing
            made.append(jaxtyped(_replayed(function), typechecker=typechecker))
        return made[0](*args, **kwargs)

    @wraps(function)
    def checked(*args: Any, **kwargs: Any) -> Any:
        if config.jaxtyping_disable:
            return function(*args, **kwargs)
        if not fitting:
            fitting[None] = _ways(function)
        ways = fitting[None]
        try:
            kind = tuple([ways[type(each)](each) for each in args])
            if kwargs:
                kind += tuple([(name, ways[type(each)](each)) for name, each in kwargs.items()])
            results = fitting.get(kind)
        except _Unlike:
            return careful(*args, **kwargs)
        result = function(*args, **kwargs) if results else careful(*args, **kwargs)
        try:
            of_result = ways[type(result)](result)
        except _Unlike:
            of_result = None
        if results:
            if of_result in results:
                return result
            _GIVEN.result = (function, result)
            try:
                careful(*args, **kwargs)
            finally:
                _GIVEN.result = None
        if of_result is not None and len(fitting) < MOST_REMEMBERED:
            fitting.setdefault(kind, set()).add(of_result)
        return result

    return checked  # pyright: ignore[reportReturnType]


def _replayed(function: Callable[..., Any], given: threading.local = _GIVEN) -> Callable[..., Any]:
    """The function, or at once what it is said to have returned, with the names that its annotations are in."""

    def replay(*args: Any, **kwargs: Any) -> Any:
        returned = getattr(given, "result", None)
        if returned is None or returned[0] is not function:
            return function(*args, **kwargs)
        given.result = None
        return returned[1]

    names = function.__globals__  # pyright: ignore[reportFunctionMemberAccess]
    return wraps(function)(FunctionType(replay.__code__, names, function.__name__, None, replay.__closure__))


class _Unlike(Exception):
    """Values of this kind may differ in whether they fit."""


class _Ways(dict[type, Callable[[Any], Hashable]]):
    """How to find, of a value of each type, all that decides whether it fits an annotation.

    Beartype looks at each item of a tuple of fixed length, but draws one item of other collections. Where an annotation
    has some (`draws`), it depends on chance whether items of different kinds fit.

    Args:
        draws: Whether an annotation has collections of which an item is drawn.
        literal: Whether an annotation may name values.
    """

    def __init__(self, draws: bool, literal: bool) -> None:
        self.draws, self.literal = draws, literal

    def __missing__(self, made: type) -> Callable[[Any], Hashable]:
        self[made] = found = self._way(made)
        return found

    def _way(self, made: type) -> Callable[[Any], Hashable]:
        if issubclass(made, np.ndarray) or (hasattr(made, "shape") and hasattr(made, "dtype")):
            return lambda value: (made, value.dtype, value.shape)
        if issubclass(made, type) or (self.literal and issubclass(made, str | int)):
            return lambda value: (made, value)
        if issubclass(made, tuple):
            return self._alike if self.draws and not hasattr(made, "_fields") else self._items
        if made is SimpleNamespace:
            return self._nothing
        if not self.draws or not issubclass(made, Collection) or issubclass(made, str | bytes | range):
            return lambda value: made
        return self._alike if issubclass(made, list) else self._mapping if issubclass(made, dict) else self._nothing

    def _items(self, value: Any) -> Hashable:
        return type(value), *[self[type(each)](each) for each in value]

    def _alike(self, value: Any) -> Hashable:
        kinds = {self[type(each)](each) for each in value}
        if len(kinds) > 1:
            raise _Unlike
        return type(value), len(value), *kinds

    def _mapping(self, value: Any) -> Hashable:
        return type(value), self._alike(list(value)), self._alike(list(value.values()))

    def _nothing(self, value: Any) -> Hashable:
        raise _Unlike


def _ways(function: Callable[..., Any]) -> _Ways:
    """Of a function's annotations, of the most careful kind where they cannot be read here."""
    try:
        hints = list(get_type_hints(function).values())
    except (NameError, TypeError, ValueError):
        return _WAYS[True, True]
    draws = literal = False
    while hints:
        hint = hints.pop()
        origin, inner = get_origin(hint), get_args(hint)
        literal |= origin is Literal
        draws |= origin is tuple and inner[-1:] == (...,)
        draws |= inspect.isclass(origin) and origin is not tuple and issubclass(origin, Iterable)
        hints.extend(() if origin is Literal else inner)
    return _WAYS[draws, literal]


_WAYS = {(draws, literal): _Ways(draws, literal) for draws in (False, True) for literal in (False, True)}
_FITTING: dict[CodeType, dict[Any, Any]] = {}


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
