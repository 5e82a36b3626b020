"""The directive `commands`: a section for each command with what `cableway NAME --help` prints."""

from __future__ import annotations

import io
import os
from contextlib import redirect_stdout
from typing import get_args
from unittest.mock import patch

from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx

from cableway.cli import commands, main

WIDTH = "90"
"""Columns of the help."""


def names() -> list[str]:
    """Of all commands, in the order of the help."""
    return [command.__name__.lower() for command in get_args(commands.Command)]


def help_text(*arguments: str) -> str:
    """What the command prints when asked for help."""
    shown = io.StringIO()
    with redirect_stdout(shown), patch.dict(os.environ, COLUMNS=WIDTH):
        main([*arguments, "--help"])
    return "\n".join(line.rstrip() for line in shown.getvalue().strip().splitlines())


class Commands(Directive):
    """Takes no arguments and has no content."""

    def run(self) -> list[nodes.Node]:
        """One section for each command."""
        return [self._section(name) for name in names()]

    def _section(self, name: str) -> nodes.section:
        section = nodes.section(ids=[f"cableway-{name}"], names=[f"cableway {name}"])
        section += nodes.title("", f"cableway {name}")
        usage, what, options = help_text(name).split("\n\n", 2)
        section += nodes.paragraph("", "", *_with_code(what))
        section += nodes.literal_block(text := f"{usage}\n\n{options}", text, language="text")
        return section


def _with_code(text: str) -> list[nodes.Node]:
    """The text, what stands between backticks as code."""
    parts = enumerate(text.split("`"))
    return [nodes.literal("", part) if place % 2 else nodes.Text(part) for place, part in parts]


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True}
