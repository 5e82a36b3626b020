"""The directive `registry`: a table of what is registered by name, with the descriptions that the code has."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx

from cableway.benchmark.conditions import CONDITIONS
from cableway.benchmark.methods import BUILT_IN
from cableway.benchmark.suites import PLANNER_SUITES, SIZES, SPACE_SUITES, SUITES, Suite

Row = Sequence[str]


def suite_rows(names: Iterable[str]) -> list[Row]:
    """Head and rows of suites, in the order in which they are registered."""
    wanted = set(names)
    chosen = [suite for name, suite in SUITES.items() if name in wanted]
    return [("suite", "contents", f"episodes: {', '.join(SIZES)}"), *map(_suite_row, chosen)]


def _suite_row(suite: Suite) -> Row:
    own = suite.own_sizes or suite.sizes
    counts = (
        f"{size:,}" if size == mine else f"{size:,} ({mine:,})" for size, mine in zip(suite.sizes, own, strict=True)
    )
    return suite.name, suite.description, ", ".join(counts)


TABLES = {
    "planner-suites": lambda: suite_rows(PLANNER_SUITES),
    "controller-suites": lambda: suite_rows(SUITES.keys() - PLANNER_SUITES - SPACE_SUITES),
    "space-suites": lambda: suite_rows(SPACE_SUITES),
    "methods": lambda: [("method", "what it is"), *((name, method.description) for name, method in BUILT_IN.items())],
    "conditions": lambda: [("condition", "what differs"), *((name, it.description) for name, it in CONDITIONS.items())],
}
"""Head and rows by the argument of the directive."""


class Registry(Directive):
    """Takes a name of `TABLES`; the first column is set as code."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """One table."""
        if self.arguments[0] not in TABLES:
            raise self.error(f"{self.arguments[0]} is none of {', '.join(TABLES)}")
        head, *rows = TABLES[self.arguments[0]]()
        group = nodes.tgroup(cols=len(head))
        group += [nodes.colspec(colwidth=1) for _ in head]
        group += nodes.thead("", _row([nodes.Text(text) for text in head]))
        group += nodes.tbody("", *(_row([nodes.literal("", name), *map(nodes.Text, rest)]) for name, *rest in rows))
        return [nodes.table("", group)]


def _row(cells: Sequence[nodes.Node]) -> nodes.row:
    return nodes.row("", *(nodes.entry("", nodes.paragraph("", "", cell)) for cell in cells))


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_directive("registry", Registry)
    return {"parallel_read_safe": True}
