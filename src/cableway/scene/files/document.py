"""YAML files read safely and strictly, with the line of every value.

Scalars are read as YAML 1.2 reads them: `1e-3` is a number, `on` and `2024-01-01` are texts, `010` is ten.
No tag constructs anything but plain data, and a key may stand only once in a mapping.
"""

from __future__ import annotations

import re
from collections.abc import Hashable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from cableway.core.errors import FileFormatError, Place, TaskError
from cableway.core.reading import one_line, read_bytes, require_depth

LARGEST_FILE = 500_000
"""Bytes; a task with 200 keypoints and 1000 obstacles has a fifth of it, and PyYAML reads about 20 kB/s."""

_PLAIN = (
    ("tag:yaml.org,2002:null", r"(?:~|null|Null|NULL|)", ["~", "n", "N", ""]),
    ("tag:yaml.org,2002:bool", r"(?:true|True|TRUE|false|False|FALSE)", list("tTfF")),
    ("tag:yaml.org,2002:int", r"[-+]?[0-9]+", list("-+0123456789")),
    (
        "tag:yaml.org,2002:float",
        r"(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))",
        list("-+.0123456789"),
    ),
)
"""Tag, pattern and first characters of the scalars that are not texts (YAML 1.2.2, section 10.3.2)."""


class Loader(yaml.SafeLoader):
    """A safe loader of YAML 1.2 scalars that refuses duplicate keys."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012 - PyYAML's own class attribute

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        """The mapping of a node; a duplicate key is an error."""
        seen: dict[Any, Any] = {}
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, Hashable) and key in seen:
                problem = f"the key {key!r} appears here and in line {seen[key].line + 1}"
                raise yaml.constructor.ConstructorError(None, None, problem, key_node.start_mark)
            if isinstance(key, Hashable):
                seen[key] = key_node.start_mark
        return super().construct_mapping(node, deep=deep)


class Dumper(yaml.SafeDumper):
    """A dumper that quotes just those texts which `Loader` would read as something else."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012 - PyYAML's own class attribute

    def ignore_aliases(self, data: Any) -> bool:
        """Write every value where it stands."""
        return True

    def represent_str(self, data: str) -> yaml.ScalarNode:
        """A text, quoted with escapes where PyYAML would lose one of the rarer line breaks."""
        style = '"' if re.search("[\r\x85\u2028\u2029]", data) else None
        return self.represent_scalar("tag:yaml.org,2002:str", data, style)


for _tag, _pattern, _first in _PLAIN:
    for _class in (Loader, Dumper):
        _class.add_implicit_resolver(_tag, re.compile(rf"^{_pattern}$"), _first)
Dumper.add_representer(str, Dumper.represent_str)
Loader.add_constructor("tag:yaml.org,2002:int", lambda loader, node: int(node.value))


@dataclass(frozen=True)
class Document:
    """A mapping read from a YAML file.

    Attributes:
        path: The file.
        data: Its content.
        root: The node that stands for it, which knows the lines.
    """

    path: Path
    data: dict[Any, Any]
    root: yaml.MappingNode

    def line(self, place: Place) -> int:
        """The line (from 1) of the value at a place, or of the nearest mapping or list around it."""
        node: yaml.Node = self.root
        line = node.start_mark.line
        for step in place:
            key, value = _child(node, step)
            if value is None:
                break
            node = value
            line = (value if key is None else key).start_mark.line
        return line + 1

    def locate(self, error: TaskError) -> TaskError:
        """The same error with file and line."""
        return error.found_in(f"{self.path}:{self.line(error.place)}")


def _child(node: yaml.Node, step: str | int) -> tuple[yaml.Node | None, yaml.Node | None]:
    """The key and value nodes one step down."""
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            if key.value == str(step):
                return key, value
    elif isinstance(node, yaml.SequenceNode) and isinstance(step, int) and step < len(node.value):
        return None, node.value[step]
    return None, None


def read_document(path: Path) -> Document:
    """Read a YAML file that holds one mapping.

    Raises:
        FileFormatError: The file is missing, a folder, unreadable, not YAML, empty or no mapping.
    """
    content = read_bytes(path, LARGEST_FILE)
    try:
        loader = Loader(content)
        try:
            root = loader.get_single_node()
            data = None if root is None else loader.construct_document(root)
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = "" if mark is None else f":{mark.line + 1}"
        raise FileFormatError(f"{path}{line}: not valid YAML: {one_line(error.problem or error.context)}") from None
    except RecursionError:
        raise FileFormatError(f"{path}: not valid YAML: nested too deeply") from None
    except yaml.reader.ReaderError:
        raise FileFormatError(f"{path}: not valid YAML: it is not text in UTF-8, or has control characters") from None
    except yaml.YAMLError as error:
        raise FileFormatError(f"{path}: not valid YAML: {one_line(error)}") from None
    except (ValueError, TypeError, AttributeError, LookupError, OverflowError):
        # what PyYAML lets through where it cannot make the value that a tag asks for
        raise FileFormatError(f"{path}: not valid YAML: a value does not match its tag") from None
    if root is None or data is None:
        raise FileFormatError(f"{path}: the file is empty, but must be a mapping of keys to values")
    if not (isinstance(root, yaml.MappingNode) and isinstance(data, dict)):
        raise FileFormatError(f"{path}: must be a mapping of keys to values, not a {type(data).__name__}")
    require_depth(data, f"{path}: not valid YAML")
    return Document(path, data, root)
