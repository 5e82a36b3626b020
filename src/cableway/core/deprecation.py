"""Old names, which go on working for one release with a warning that says the new one."""

from __future__ import annotations

import functools
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable[..., Any])
C = TypeVar("C", bound=type)

GOES = "; the old name goes with the next release"
"""How every warning of this module ends."""

MODULES = {
    "benchmark.plants": "simulation.perturbations.variants",
    "control.mpc_config": "tang2025.control.mpc_config",
    "control.neural_mpc": "tang2025.control.neural_mpc",
    "control.plug_push": "control.insertion",
    "control.rod_estimate": "estimation.rod_filter",
    "errors": "core.errors",
    "files": "core.files",
    "models": "tang2025.models",
    "models.adaptation": "tang2025.models.adaptation",
    "models.base": "tang2025.models.base",
    "models.baselines": "tang2025.models.base",
    "models.checkpoint": "tang2025.models.checkpoint",
    "models.conv": "tang2025.models.networks",
    "models.evaluation": "tang2025.models.evaluation",
    "models.frames": "tang2025.models.frames",
    "models.learned": "tang2025.models.learned",
    "models.mlp": "tang2025.models.networks",
    "models.recipe": "tang2025.models.recipe",
    "models.recurrent": "tang2025.models.networks",
    "models.rod": "tang2025.models.networks",
    "models.training": "tang2025.models.training",
    "models.training_config": "tang2025.models.training",
    "models.transformer": "tang2025.models.transformer",
    "planning.explore": "planning.rrt_connect",
    "planning.passages": "planning.routes.passages",
    "planning.push": "planning.insertion",
    "planning.realization": "planning.projection",
    "planning.refinement": "planning.trajectory_optimization",
    "provenance": "core.provenance",
    "rehearsal": "workflow.rehearsal",
    "scene.loading": "scene.files.loading",
    "scene.presets": "scene.files.presets",
    "scene.random": "tasks",
    "scene.random.tasks": "tasks.generation",
    "scene.saving": "scene.files.saving",
    "simulation.executors": "core.executors",
    "simulation.grasp": "simulation.perturbations.grasp",
    "simulation.motion": "simulation.random_motion",
    "simulation.sensing": "simulation.perturbations.sensing",
}
"""Modules of release 0.1 whose names the documentation showed, and where they are now; both below `cableway`."""


class _MovedModule(ModuleType):
    """Stands at the old place of a module and gives what is at the new one."""

    def __init__(self, name: str, home: str) -> None:
        super().__init__(name, f"Moved to `{home}`.")
        self._home = home

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        module = import_module(self._home)
        value = getattr(module, name) if hasattr(module, name) else _submodule(self._home, name)
        _warn(f"{self.__name__} has moved to {self._home}", stacklevel=3)
        return value


def _submodule(home: str, name: str) -> ModuleType:
    try:
        return import_module(f"{home}.{name}")
    except ModuleNotFoundError:
        raise AttributeError(f"module {home!r} has no attribute {name!r}") from None


def keep_moved_modules() -> None:
    """Let `from cableway.OLD import name` find the modules of `MODULES` at their new places.

    Nothing is imported before a name is asked for, and nothing outside this package changes.
    """
    for old, new in MODULES.items():
        name = f"cableway.{old}"
        sys.modules.setdefault(name, _MovedModule(name, f"cableway.{new}"))


def renamed(
    module: str, names: Mapping[str, str], otherwise: Callable[[str], Any] | None = None
) -> Callable[[str], Any]:
    """A module's `__getattr__` under which renamed attributes keep their old names.

    Args:
        module: Its `__name__`.
        names: New name of each old one, in this module or, with dots, in another one below `cableway`.
        otherwise: Finds other attributes of the module.
    """

    def getattribute(name: str) -> Any:
        if name not in names and otherwise is not None:
            return otherwise(name)
        if name not in names:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        home, _, new = f"{module}.{names[name]}".rpartition(".")
        if "." in names[name]:
            home = f"cableway.{names[name].rpartition('.')[0]}"
        _warn(f"{module}.{name} is now {home}.{new}", stacklevel=3)
        return getattr(import_module(home), new)

    return getattribute


def renamed_keywords(**names: str) -> Callable[[F], F]:
    """A decorator under which renamed keyword arguments keep their old names; `names` maps old to new.

    Raises:
        TypeError: In a call: an argument is given under both names.
    """

    def decorate(function: F) -> F:
        @functools.wraps(function)
        def call(*args: Any, **kwargs: Any) -> Any:
            for old in [old for old in names if old in kwargs]:
                if names[old] in kwargs:
                    raise TypeError(f"{function.__qualname__} got {names[old]!r} and its old name {old!r}")
                _warn(f"{function.__qualname__}: the argument {old!r} is now {names[old]!r}", stacklevel=3)
                kwargs[names[old]] = kwargs.pop(old)
            return function(*args, **kwargs)

        return call  # pyright: ignore[reportReturnType]

    return decorate


def renamed_attributes(**names: str) -> Callable[[C], C]:
    """A decorator of a class under which renamed attributes can be read by their old names; `names` maps old to new."""

    def decorate(cls: C) -> C:
        for old, new in names.items():

            def read(self: Any, old: str = old, new: str = new) -> Any:
                _warn(f"{cls.__qualname__}.{old} is now {cls.__qualname__}.{new}", stacklevel=3)
                return getattr(self, new)

            setattr(cls, old, property(read))
        return cls

    return decorate


@contextmanager
def old_names_heard() -> Iterator[list[str]]:
    """What is said meanwhile of old names, each sentence once; Python shows it only to who runs tests."""
    heard: list[str] = []
    with warnings.catch_warnings():
        warnings.filterwarnings("always", f".*{GOES}$", DeprecationWarning)
        show = warnings.showwarning

        def listen(message: Warning | str, category: type[Warning], *where: Any) -> None:
            if not str(message).endswith(GOES):
                show(message, category, *where)
            elif str(message) not in heard:
                heard.append(str(message))

        warnings.showwarning = listen
        yield heard


def renamed_value(kind: str, name: str, names: Mapping[str, str]) -> str:
    """The new name of a `kind` of thing that files and arguments may call by an old one; `names` maps old to new."""
    if name in names:
        _warn(f"the {kind} {name!r} is now {names[name]!r}", stacklevel=4)
    return names.get(name, name)


def _warn(what: str, stacklevel: int) -> None:
    warnings.warn(f"{what}{GOES}", DeprecationWarning, stacklevel=stacklevel)
