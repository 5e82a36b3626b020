"""Laws of arms of one's own: shipped models, written out, are the same; others are refused in one sentence."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

import cableway as cw
from cableway.core.errors import TaskError
from cableway.scene.arm_models import ARM_MODELS, ArmModel
from cableway.scene.files.loading import load_cell
from cableway.scene.files.saving import save_task
from cableway.scene.own_arms import LIMITS, TWISTS


def written(model: ArmModel, like: str) -> dict[str, Any]:
    """A model as a file gives it."""
    d1, a2, a3, d4, d5, d6 = model.lengths
    places = ((0, d1), (a2, 0), (a3, 0), (0, d4), (0, d5), (0, d6))
    return {
        "name": model.name,
        "like": like,
        "dh": [[a, d, math.radians(twist)] for (a, d), twist in zip(places, TWISTS, strict=True)],
        "capsules": [{**vars(each), "start": list(each.start), "end": list(each.end)} for each in model.capsules],
        **{name: list(getattr(model, name)) for name in LIMITS},
    }


def cell_file(path: Path, arm: dict[str, Any], **keys: Any) -> Path:
    arms = [{"model": arm, "position": [-0.6, 0, 0]}, {"model": "ur5e", "position": [0.55, 0, 0.15], "angle": 3.14159}]
    path.write_text(yaml.safe_dump({"cableway": 1, "name": "own", "arms": arms, **keys}, sort_keys=False))
    return path


@pytest.mark.parametrize("name", ARM_MODELS)
def test_a_shipped_model_written_out_is_that_model(name: str, tmp_path: Path):
    model = ARM_MODELS[name]
    cell = load_cell(cell_file(tmp_path / "cell.yaml", written(model, name)))
    assert cell.models == (model, ARM_MODELS["ur5e"])
    task = cw.load_task("single-obstacle-1").unchecked().in_cell(cell).checked()
    save_task(task, tmp_path / "task.yaml")
    assert cw.load_task(tmp_path / "task.yaml").cell == cell


def test_what_is_not_stated_is_that_of_the_model_it_is_like(tmp_path: Path):
    arm = written(ARM_MODELS["ur5e"], "ur10e")
    stated = {name: arm[name] for name in ("name", "like", "dh", "capsules", "torque_limit")}
    found = load_cell(cell_file(tmp_path / "cell.yaml", stated)).models[0]
    ur5e, ur10e = ARM_MODELS["ur5e"], ARM_MODELS["ur10e"]
    kept = replace(ur10e, **{name: getattr(ur5e, name) for name in ("name", "lengths", "capsules", "torque_limit")})
    assert found == kept


def test_lengths_and_angles_are_in_the_units_of_the_file(tmp_path: Path):
    arm, model = written(ARM_MODELS["ur5e"], "ur5e"), ARM_MODELS["ur5e"]
    arm = {name: arm[name] for name in ("name", "like", "dh", "capsules")} | {"position_limit": [360] * 6}
    arm["dh"] = [[1000 * a, 1000 * d, twist] for (a, d, _), twist in zip(arm["dh"], TWISTS, strict=True)]
    for each in arm["capsules"]:
        each |= {"start": [1000 * x for x in each["start"]], "end": [1000 * x for x in each["end"]]}
        each["radius"] *= 1000
    found = load_cell(cell_file(tmp_path / "cell.yaml", arm, units="mm", angles="deg")).models[0]
    assert found.lengths == pytest.approx(model.lengths)
    assert found.capsules[3].radius == pytest.approx(model.capsules[3].radius)
    assert found.position_limit == pytest.approx([2 * math.pi] * 6)


def with_row(row: int, column: int, value: float) -> Callable[[dict[str, Any]], None]:
    return lambda arm: arm["dh"][row].__setitem__(column, value)


ONLY = "the only structure known is that of a UR: twists of 90, 0, 0, 90, -90, 0 degrees and d1, a2, a3, d4, d5, d6"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (with_row(0, 0, 0.025), rf"dh\[0\]\[0\] is 0.025 m, not 0, and {ONLY}"),
        (with_row(1, 2, math.pi / 2), rf"dh\[1\]\[2\] is 90 degrees, not 0, and {ONLY}"),
        (with_row(2, 0, 0.0), rf"dh\[2\]\[0\] is 0 m, less than 0.01 m, and {ONLY}"),
        (lambda arm: arm["dh"].append([0, 0.1, 0]), rf"dh has 7 joints, and {ONLY}"),
        (lambda arm: arm.update(like="iiwa"), "like must be one of ur5e, ur10e, ur3e, got 'iiwa'"),
        (lambda arm: arm["capsules"].pop(), "capsules must hold every link, there is none of frame 6"),
        (lambda arm: arm["capsules"][3].update(frame=7), r"capsules\[3\].frame must be from 0 to 6, got 7"),
        (lambda arm: arm["capsules"][3].update(end=arm["capsules"][3]["start"]), "must be another point than start"),
        (lambda arm: arm["capsules"][3].update(radius=59), r"capsules\[3\].radius must be from 0.001 to 1 m, got 59"),
        (lambda arm: arm["speed_limit"].pop(), "speed_limit must be six numbers, from base to flange, got 5"),
        (lambda arm: arm.update(urdf="arm.urdf"), "urdf is not a known key"),
        (lambda arm: arm.pop("capsules"), "capsules is missing"),
    ],
)
def test_what_is_no_such_arm_is_said_in_one_sentence(change: Callable[[dict], Any], said: str, tmp_path: Path):
    arm = written(ARM_MODELS["ur5e"], "ur5e")
    change(arm)
    with pytest.raises(TaskError, match=rf"cell.yaml:\d+: arms\[0\].model.*{said}"):
        load_cell(cell_file(tmp_path / "cell.yaml", arm))
