"""Code of a user's own, named in an option: "package.module:NAME" or "FILE.py:NAME". To load it is to run it."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from cableway.core.errors import InputError, raised, said


def is_plugin(source: str) -> bool:
    """Whether a text names a user's own code rather than something that comes with cableway, or a file.

    >>> [is_plugin(each) for each in ("lab.bench:Bench", "bench.py:BENCH", "rod-mpc", "12:30/lab.yaml")]
    [True, True, False, False]
    """
    return source.rpartition(":")[1] == ":" and source.rpartition(":")[2].isidentifier()


def require_name(source: str) -> None:
    """Refuse a text that names a file of code and nothing in it.

    Raises:
        InputError: It does.
    """
    file = source.removesuffix(":")
    if file.endswith(".py"):
        raise InputError(f"{source}: which of the names in it is meant must follow the file, as in {file}:NAME")


def load_plugin(source: str, kind: type | None = None) -> tuple[Any, Path]:
    """What a text names, and the file that it is in.

    Args:
        source: "package.module:NAME", imported from the current directory or the environment, or "FILE.py:NAME".
        kind: What is wanted, for the message on a name that is not there; classes and functions where None.

    Raises:
        InputError: There is no such file, module or name, or its code fails.
    """
    place, _, name = source.rpartition(":")
    module = _from_file(Path(place)) if place.endswith(".py") else _imported(place, source)
    if getattr(module, "__file__", None) is None:
        raise InputError(f"{source}: {place} is built into Python; a module of your own is wanted")
    file = Path(module.__file__ or place).resolve()
    if not hasattr(module, name):
        own = [each for each, value in vars(module).items() if _is_meant(value, kind, module)]
        nothing = "neither classes nor functions" if kind is None else f"no {kind.__name__}"
        raise InputError(f"{file}: has no {name!r}; it has {', '.join(own) or nothing}")
    return getattr(module, name), file


def _is_meant(value: Any, kind: type | None, module: ModuleType) -> bool:
    return getattr(value, "__module__", "") == module.__name__ if kind is None else isinstance(value, kind)


def _from_file(file: Path) -> ModuleType:
    if not file.is_file():
        raise InputError(f"{file}: no such file")
    spec = importlib.util.spec_from_file_location(f"plugin {file.resolve()}", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # a data class looks its annotations up there
    try:
        spec.loader.exec_module(module)
    except raised() as error:
        del sys.modules[spec.name]
        raise InputError(f"{file}: failed to run: {said(error)}") from None
    return module


def _imported(name: str, source: str) -> ModuleType:
    if not all(part.isidentifier() for part in name.split(".")):
        raise InputError(f"{source}: must be package.module:NAME or FILE.py:NAME")
    here = str(Path.cwd())
    if here not in sys.path:  # it is where Python finds modules in `python -m`, but not in an installed command
        sys.path.insert(0, here)
    importlib.invalidate_caches()
    try:
        return importlib.import_module(name)
    except raised() as error:
        if isinstance(error, ModuleNotFoundError) and f"{name}.".startswith(f"{error.name}."):
            where = f"neither in {here} nor in the environment"
            raise InputError(f"{source}: there is no module {error.name!r}, {where}") from None
        raise InputError(f"{source}: the module failed to run: {said(error)}") from None
