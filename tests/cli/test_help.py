"""What the help of the commands says: no default that tells nothing, no option that is refused, all choices."""

from __future__ import annotations

import re
from typing import get_args

import pytest
from commands import Command

from cableway.benchmark.methods import BUILT_IN
from cableway.benchmark.suites import SUITES
from cableway.cli.commands import Command as AnyCommand
from cableway.planning.named import PLANNERS
from cableway.tang2025.models.checkpoint import model_names
from cableway.tasks.generation import KINDS
from cableway.workflow.registry import CONTROLLERS

NAMES = [re.sub("(?<=[a-z])(?=[A-Z])", "-", command.__name__).lower() for command in get_args(AnyCommand)]


def words(text: str) -> set[str]:
    """Of a help text, in whose frames long lines are broken."""
    return set(re.findall(r"[\w.-]+\b", text))


@pytest.mark.parametrize("command", NAMES)
def test_no_default_tells_nothing(cableway: Command, command: str):
    """Without a value to name, the help says in words what happens."""
    said = cableway(command, "--help").out
    assert not re.search(r"\(default:\s*(│\s*)?(None|False)?\s*\)", said)
    assert "None" not in said


def test_a_seed_is_offered_where_it_is_taken(cableway: Command):
    """Episodes of suites have seeds of their own, and compilation draws nothing."""
    without = {
        command for command in NAMES if "--seed" not in cableway(command, "--help").out.replace("from --seed", "")
    }
    assert without == {"bench", "calibrate", "reproduce", "see", "warm-up"}
    assert cableway("bench", "clutter", "--seed", 3).status == 2


@pytest.mark.parametrize(("command", "choices"), [
    ("plan", PLANNERS), ("run", [*PLANNERS, *CONTROLLERS, *model_names()]), ("tasks", KINDS),
    ("bench", [*SUITES, *BUILT_IN, "quick", "standard", "full"]), ("train", model_names()),
    ("evaluate", model_names()), ("collect", ["local", "ray"]), ("reproduce", ["quick", "full"]),
])  # fmt: skip
def test_choices_are_listed(cableway: Command, command: str, choices: list[str]):
    """All that a registry has, so that a new name is in the help, too."""
    assert set(choices) <= words(cableway(command, "--help").out)
