"""The cell of a task file: what it means, and what is written of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cableway.core.errors import TaskError, UnknownNameError
from cableway.scene.arm_models import Capsule
from cableway.scene.cell import CELLS, Cell, MountedArm
from cableway.scene.own_arms import OwnArm


def named_cell(name: str) -> Cell:
    """The cell of a name.

    Raises:
        UnknownNameError: There is none; the message lists them.
    """
    if name not in CELLS:
        raise UnknownNameError("cell", name, tuple(CELLS))
    return CELLS[name]


def cell_of(section: Mapping[str, Any]) -> Cell:
    """The cell of a section `cell` that gives one.

    Raises:
        TaskError: It is none.
    """
    return Cell(**{**section, "arms": tuple(_arm(index, arm) for index, arm in enumerate(section["arms"]))})


def _arm(index: int, section: Mapping[str, Any]) -> MountedArm:
    try:
        if isinstance(model := section.get("model"), Mapping):
            section = {**section, "model": _own_arm(model)}
        return MountedArm(**section)
    except TaskError as error:
        raise error.within("cell", "arms", index) from None


def _own_arm(section: Mapping[str, Any]) -> OwnArm:
    """An arm that is given in the file.

    Raises:
        TaskError: It is none that is known.
    """
    capsules = []
    try:
        for index, capsule in enumerate(section["capsules"]):
            try:
                capsules.append(Capsule(**capsule))
            except TaskError as error:
                raise error.within("capsules", index) from None
        return OwnArm(**{**section, "capsules": capsules})
    except TaskError as error:
        raise error.within("model") from None


def stated_cell(cell: Cell) -> dict[str, Any]:
    """What a task file says of a cell."""
    arms = [{**vars(arm), "position": list(arm.position), "model": _arm_model(arm)} for arm in cell.arms]
    return stated({**vars(cell), "arms": arms, "way": None, "tilt": cell.tilt or None})


def stated(section: dict[str, Any]) -> dict[str, Any]:
    """A section without the values that stand for nothing."""
    return {name: value for name, value in section.items() if value is not None}


def _arm_model(arm: MountedArm) -> Any:
    if isinstance(arm.model, str):
        return arm.model
    own = {name: list(value) if isinstance(value, tuple) else value for name, value in vars(arm.model).items()}
    capsules = [{**vars(each), "start": list(each.start), "end": list(each.end)} for each in arm.model.capsules]
    return stated({**own, "dh": [list(row) for row in arm.model.dh], "capsules": capsules})
