"""XML from anywhere: no entities, nothing fetched, bounded in size and depth."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from cableway.core.errors import FileFormatError
from cableway.core.reading import one_line, read_bytes

LARGEST_FILE = 10_000_000
"""Bytes of the largest file; a drawing of a table has a hundredth of it."""

DEEPEST = 100
"""Levels of nested elements; those of a drawing with many groups have a dozen."""


def read_xml(path: Path) -> Element:
    """The root element of an XML file.

    Tags are `{namespace}name`, and names of attributes are without a namespace. A document type is read over, and what
    it or anything else refers to outside of the file is not looked for.

    Raises:
        FileFormatError: The file cannot be read, is no XML, declares entities, or is nested too deeply.
    """
    content = read_bytes(path, LARGEST_FILE)
    parser, builder, depth = expat.ParserCreate(namespace_separator="}"), TreeBuilder(), 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEEPEST:
            raise FileFormatError(f"{path}: not such XML: nested deeper than {DEEPEST} levels")
        builder.start(_tag(tag), {name.rpartition("}")[2]: value for name, value in attributes.items()})

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(_tag(tag))

    def entity(name: str, *_: object) -> None:
        raise FileFormatError(f"{path}: it declares the entity {one_line(name)!r}, and entities are not read")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.EntityDeclHandler = entity
    try:
        parser.Parse(content, True)
        return builder.close()
    except (expat.ExpatError, ValueError, LookupError, AssertionError) as error:
        raise FileFormatError(f"{path}: not XML: {one_line(error)}") from None


def _tag(name: str) -> str:
    return "{" + name if "}" in name else name
