"""Whatever stands in a task file, reading it gives a task or an input error of one line."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scene_task_files import VALID, at

from cableway.core.errors import InputError
from cableway.scene.files.loading import load_task

FUZZ = settings(
    deadline=None,
    derandomize=True,
    max_examples=40,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
numbers = st.floats() | st.integers() | st.sampled_from([0, -1, 1e-320, 1e308, 10**400, 0.3, 13, 1 << 64])
scalars = st.none() | st.booleans() | numbers | st.text(max_size=8) | st.dates()
keys = st.sampled_from(["type", "size", "box", "<box>", "grippers", "bend", "keypoints", "start"]) | scalars
values = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(keys, inner, max_size=3), max_leaves=6
)


def places(content: Any) -> list[tuple[Any, ...]]:
    """Every place below the top of nested mappings and lists."""
    if isinstance(content, dict):
        items = list(content.items())
    elif isinstance(content, list):
        items = list(enumerate(content))
    else:
        return []
    return [place for key, inner in items for place in [(key,), *((key, *below) for below in places(inner))]]


PLACES = places(VALID)
containers = [(), *(place for place in PLACES if isinstance(place[-1], str) or len(place) == 2)]


def reads_or_complains(path: Path) -> None:
    try:
        task = load_task(path)
    except InputError as error:
        message = str(error)
        assert message.startswith(str(path))
        assert "\n" not in message
        assert len(message) < 600
    else:
        assert np.isfinite(task.start).all()


@FUZZ
@given(st.lists(st.tuples(st.sampled_from(PLACES), values | st.just(...)), min_size=1, max_size=3))
def test_any_value_at_any_place(tmp_path: Path, changes: list[tuple[tuple[Any, ...], Any]]):
    content = copy.deepcopy(VALID)
    for place, value in changes:
        try:
            at(*place, value)(content)
        except (KeyError, IndexError, TypeError):
            continue  # an earlier change took the place away
    (tmp_path / "task.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    reads_or_complains(tmp_path / "task.yaml")


@FUZZ
@given(st.sampled_from(containers), keys, values)
def test_any_key_added_anywhere(tmp_path: Path, place: tuple[Any, ...], key: Any, value: Any):
    content = copy.deepcopy(VALID)
    inner: Any = content
    for step in place:
        inner = inner[step]
    if isinstance(inner, dict):
        inner[key] = value
    elif isinstance(inner, list):
        inner.append(value)
    (tmp_path / "task.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    reads_or_complains(tmp_path / "task.yaml")


@FUZZ
@given(st.data())
def test_any_piece_of_the_text_replaced(tmp_path: Path, data: st.DataObject):
    text = yaml.safe_dump(VALID, sort_keys=False, default_flow_style=None)
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, min(len(text), start + 20)))
    marks = st.text(st.sampled_from("[]{}:,-?!&*#|>'\"%@` \n\tx0.e"), max_size=6)
    piece = data.draw(
        marks | st.sampled_from(["!!int ", "!!set ", "!!binary ", "!!float ", "&a ", "*a", "<<: ", "---\n"])
    )
    (tmp_path / "task.yaml").write_text(text[:start] + piece + text[end:])
    reads_or_complains(tmp_path / "task.yaml")


@FUZZ
@given(st.binary(max_size=200))
def test_any_bytes(tmp_path: Path, content: bytes):
    (tmp_path / "task.yaml").write_bytes(content)
    reads_or_complains(tmp_path / "task.yaml")


coordinates = st.floats(0, 0.7)
poses = st.tuples(coordinates, coordinates, st.floats(-10, 10)).map(list)


@settings(FUZZ, max_examples=6)
@given(poses, poses, st.sampled_from(["left", "right"]))
def test_any_gripper_poses(tmp_path: Path, left: list[float], right: list[float], bend: str):
    content = {**VALID, "obstacles": [], "start": {"grippers": [left, right], "bend": bend}}
    (tmp_path / "task.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    reads_or_complains(tmp_path / "task.yaml")
