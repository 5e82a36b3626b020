"""Laws of recordings: whatever rate, unit and picture they are in, the transitions are those of the cable."""

from __future__ import annotations

import io
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from cableway.core.errors import InputError
from cableway.datasets.reading import load_transitions
from cableway.datasets.transitions import Transitions
from cableway.geometry.projective import mapped, plane_map

CORNERS = np.array([[0.0, 0.0], [0.7, 0.0], [0.7, 0.7], [0.0, 0.7]])
SEEN = np.array([[100.0, 900.0], [1200.0, 950.0], [1000.0, 300.0], [250.0, 200.0]])
"""A table, and where its corners are in a picture."""


def cable(times: np.ndarray, keypoints: int = 7) -> dict[str, np.ndarray]:
    """An arc of 0.3 m that moves and turns evenly, so that places in between are those of straight lines."""
    bend = 2.0 * np.linspace(-0.5, 0.5, keypoints)
    arc = 0.15 * np.column_stack([np.sin(bend), np.cos(bend)]) + [0.3, 0.2]
    shapes = arc + 0.05 * times[:, None, None] * [1.0, -0.4]
    ends = np.array([1.0, -1.0]) + 3.1 + 0.2 * times[:, None]
    poses = np.concatenate([shapes[:, [0, -1]], ends[..., None] - 3.1], axis=2)
    return {"times": times, "keypoints": shapes, "poses": poses}


def table(arrays: dict[str, np.ndarray]) -> list[list[str]]:
    """The lines of a CSV file."""
    n = arrays["keypoints"].shape[1]
    names = ["time", *(f"{axis}{k}" for k in range(n) for axis in "xy")]
    columns = [arrays["times"], *arrays["keypoints"].reshape(-1, 2 * n).T]
    if "poses" in arrays:
        names += [f"{side}_{name}" for side in ("left", "right") for name in ("x", "y", "theta")]
        columns += [*arrays["poses"].reshape(-1, 6).T]
    if "episode" in arrays:
        names, columns = [*names, "episode"], [*columns, arrays["episode"]]
    rows = np.column_stack(columns)
    return [names, *([("" if np.isnan(value) else repr(float(value))) for value in row] for row in rows)]


def write(path: Path, arrays: dict[str, np.ndarray]) -> Path:
    if path.suffix == ".npz":
        np.savez(path, **arrays)
    else:
        path.write_text("# a comment\n" + "\n".join(",".join(row) for row in table(arrays)) + "\n")
    return path


def described(path: Path, **keys: object) -> Path:
    """The description of a recording."""
    about = path.with_suffix(".yaml")
    about.write_text(yaml.safe_dump({"cableway": 1, "file": path.name, **keys}))
    return about


def same(one: Transitions, other: Transitions, tolerance: float = 1e-9) -> None:
    for name in ("keypoints", "poses", "actions", "next_keypoints", "episode"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=tolerance, err_msg=name)


STEPS = 0.1 * np.arange(21)


@pytest.fixture
def true(tmp_path: Path) -> Transitions:
    """The transitions of the cable, recorded at the step of control."""
    return load_transitions(write(tmp_path / "true.npz", cable(STEPS)))


def test_a_recording_at_the_step_of_control_is_kept_as_it_is(true):
    arrays = cable(STEPS)
    np.testing.assert_allclose(true.keypoints, arrays["keypoints"][:-1], atol=1e-12)
    np.testing.assert_allclose(true.next_keypoints, arrays["keypoints"][1:], atol=1e-12)
    np.testing.assert_allclose(true.actions, np.diff(arrays["poses"], axis=0), atol=1e-12)
    assert true.metadata["config"]["poses"] == "recorded"


@pytest.mark.parametrize("ending", [".csv", ".npz"])
@pytest.mark.parametrize(
    "times",
    [np.arange(0.0, 2.001, 1 / 30), 1.7e9 + np.arange(0, 2.01, 0.04), np.cumsum([0.0, *[0.013, 0.11, 0.04] * 13])[:-1]],
)
def test_times_of_any_rate_and_origin_give_the_same_steps(tmp_path, true, ending, times):
    arrays = cable(times - times[0])
    data = load_transitions(write(tmp_path / f"r{ending}", {**arrays, "times": times}))
    assert len(data) == 20
    same(data, true, 1e-7)


def test_units_are_said_in_the_description(tmp_path, true):
    arrays = cable(STEPS)
    arrays["keypoints"] *= 1000
    arrays["poses"] *= np.array([1000, 1000, 180 / np.pi])
    path = write(tmp_path / "r.csv", arrays)
    data = load_transitions(described(path, units="mm", angles="deg", cable={"length": 310}))
    same(data, true)
    assert data.metadata["config"]["cable"]["length"] == pytest.approx(0.31)
    with pytest.raises(InputError, match=r"is it in mm\? Say `units: mm` in a YAML file that names this one"):
        load_transitions(path)


@pytest.mark.parametrize("count", [3, 4])
def test_pixels_are_where_the_calibration_sees_them(tmp_path, true, count):
    """Of a picture taken aslant four points say all, of one from straight above three."""
    arrays = cable(STEPS)
    arrays["keypoints"] = mapped(plane_map(CORNERS[:count], SEEN[:count]), arrays["keypoints"])
    calibration = {"pixels": SEEN[:count].tolist(), "table": CORNERS[:count].tolist()}
    same(load_transitions(described(write(tmp_path / "r.csv", arrays), units="px", calibration=calibration)), true)


def test_a_scale_turns_a_picture_upright(tmp_path):
    arrays = cable(STEPS)
    del arrays["poses"]
    upright = load_transitions(write(tmp_path / "m.npz", arrays))
    arrays["keypoints"] = arrays["keypoints"] * [2000, -2000]
    same(load_transitions(described(write(tmp_path / "r.npz", arrays), units="px", scale=5e-4)), upright)


def test_a_gap_ends_a_segment_unless_it_is_bridged(tmp_path):
    arrays = {name: np.delete(array, [8, 9], axis=0) for name, array in cable(STEPS).items()}
    path = write(tmp_path / "r.npz", arrays)
    data = load_transitions(path)
    assert np.bincount(data.episode).tolist() == [7, 10]
    assert data.metadata["config"]["seconds_used"] == pytest.approx(1.7)
    assert len(load_transitions(described(path, gap=0.35))) == 20


def test_a_point_out_of_sight_is_bridged_for_as_long_as_a_gap(tmp_path, true):
    """And a point of which one coordinate is missing is out of sight."""
    arrays = cable(STEPS)
    arrays["keypoints"][5, 3, 0] = arrays["poses"][9, 1, 2] = np.nan
    same(load_transitions(write(tmp_path / "r.csv", arrays)), true)
    arrays["keypoints"][5:8, 3] = np.nan
    assert np.bincount(load_transitions(write(tmp_path / "r.csv", arrays)).episode).tolist() == [4, 12]


def test_episodes_and_segments_do_not_run_into_each_other(tmp_path):
    arrays = cable(STEPS)
    arrays |= {"times": np.concatenate([STEPS[:9], STEPS[:12]]), "episode": np.array([4] * 9 + [2] * 12)}
    path = write(tmp_path / "r.csv", arrays)
    assert np.bincount(load_transitions(path).episode).tolist() == [8, 11]
    data = load_transitions(described(path, segment=0.5))
    assert np.bincount(data.episode).tolist() == [5, 3, 5, 5, 1]
    np.testing.assert_array_equal(data.next_keypoints[4], data.keypoints[5])


@pytest.mark.parametrize(("keypoints", "degrees"), [(7, 2.0), (13, 0.5)])
def test_without_poses_the_ends_of_the_cable_give_them(tmp_path, keypoints, degrees):
    """Of an arc of 2 rad the tangents at the ends are known; the parabola errs by the square of the spacing."""
    arrays = cable(STEPS, keypoints)
    del arrays["poses"]
    data = load_transitions(write(tmp_path / "r.csv", arrays))
    np.testing.assert_allclose(data.poses[..., :2], data.keypoints[:, [0, -1]])
    assert np.degrees(np.abs(data.poses[..., 2] - [1.0, -1.0])).max() < degrees
    assert data.metadata["config"]["poses"] == "from the cable's ends"


def test_shapes_are_resampled_and_the_cable_is_told(tmp_path):
    path = write(tmp_path / "r.npz", cable(STEPS))
    data = load_transitions(described(path, cable={"preset": "usb", "keypoints": 13}))
    assert data.keypoints.shape == (20, 13, 2)
    assert data.metadata["config"]["cable"]["preset"] == "usb"
    spacing = np.linalg.norm(np.diff(data.keypoints, axis=1), axis=2)
    assert spacing.max() < 1.02 * spacing.min()
    assert load_transitions(path).metadata["config"]["cable"] == {
        "length": pytest.approx(0.2986, abs=1e-3),
        "keypoints": 7,
    }


# ------------------------------------------------------------------------------------------------ what is refused
Change = Callable[[list[list[str]]], object]


def cell(row: int, column: int, text: str) -> Change:
    def change(rows: list[list[str]]) -> None:
        rows[row][column] = text

    return change


WRONG_CSV: dict[str, tuple[Change, str]] = {
    "a word": (cell(3, 4, "far"), r"line 5: y1 must be a number or empty, got 'far'"),
    "an infinite place": (cell(3, 4, "-inf"), r"line 5: y1 must be a number of at most 1e\+12, got -inf"),
    "no time": (cell(3, 0, ""), "line 5: time must be a number of at most 1e.12, got nothing"),
    "the same time again": (cell(4, 0, "0.2"), r"line 6: time is 0\.2 s, not after the 0\.2 s of the row before"),
    "a time before": (cell(4, 0, "0.1"), r"line 6: time is 0\.1 s, not after the 0\.2 s of the row before"),
    "milliseconds": (lambda rows: [row.__setitem__(0, f"{100 * k}") for k, row in enumerate(rows[1:])],
                     "without a gap of more than 0.25 s; the rows are 100 s apart"),
    "a value too few": (lambda rows: rows[7].pop(), "line 9: must have 21 values, got 20"),
    "no time at all": (cell(0, 0, "t"), "'time' is missing; it has"),
    "half a keypoint": (cell(0, 2, "z"), "'y0' is missing"),
    "a keypoint too many": (cell(0, 2, "x9"), "'y0' is missing"),
    "half a pose": (cell(0, 15, "left"), "there must be all or none"),
    "the same column again": (cell(0, 1, "y0"), "the column 'y0' stands twice"),
    "a quote without end": (cell(3, 4, '"'), "line 5: not comma-separated values"),
    "names only": (lambda rows: rows.__delitem__(slice(1, None)), "at least 2 rows of 3 to 200 keypoints, got 0 of 7"),
    "nothing": (lambda rows: rows.clear(), "the file is empty"),
    "a keypoint never seen": (lambda rows: [row.__setitem__(5, "") for row in rows[1:]], "keypoint 2 is seen in no"),
    "a place in another unit": (cell(3, 4, "300"), r"line 5: y1 is 300 m, farther than 50 m .* is it in mm\?"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG_CSV)
def test_what_is_wrong_in_a_table_is_said_with_its_line_and_column(tmp_path, name):
    rows = table(cable(STEPS))
    change, said = WRONG_CSV[name]
    change(rows)
    path = tmp_path / "r.csv"
    path.write_text("# a comment\n" + "\n".join(",".join(row) for row in rows))
    with pytest.raises(InputError, match=said) as caught:
        load_transitions(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def nowhere(arrays: dict[str, np.ndarray], name: str, value: np.ndarray | None) -> None:
    if value is None:
        del arrays[name]
    else:
        arrays[name] = value


def exchanged(arrays: dict[str, np.ndarray]) -> np.ndarray:
    return arrays["poses"][:, ::-1]


WRONG_NPZ: dict[str, tuple[str, Callable[[dict[str, np.ndarray]], np.ndarray | None], str]] = {
    "no times": ("times", lambda a: None, r"has the arrays times and keypoints; it has \['keypoints', 'poses'\]"),
    "keypoints in space": ("keypoints", lambda a: np.zeros((21, 7, 3)), r"with m = 21, got float64\[21, 7, 3\]"),
    "rows of other numbers": ("times", lambda a: STEPS[1:], r"'keypoints' must be numbers of shape \(m, n, 2\)"),
    "texts": ("times", lambda a: a["times"].astype(str), r"'times' must be numbers of shape \(m,\) .*, got <U32"),
    "objects": ("times", lambda a: a["times"].astype(object), "holds Python objects, which are never read"),
    "a pose for both": ("poses", lambda a: a["poses"][:, 0], r"'poses' must be numbers of shape \(m, 2, 3\)"),
    "a time that is none": ("times", lambda a: np.where(STEPS == 0.5, np.nan, STEPS), r"times\[5\] must be a number"),
    "two keypoints": ("keypoints", lambda a: a["keypoints"][:, :2], "3 to 200 keypoints, got 21 of 2"),
    "grippers exchanged": ("poses", exchanged, r"are left and right exchanged\?"),
    "grippers elsewhere": ("poses", lambda a: a["poses"] + 1.0, r"are both in one frame and unit\?"),
    "a tangent inwards": ("poses", lambda a: a["poses"] + np.array([[0, 0, 0], [0, 0, np.pi]]), "theta of the right"),
    "a cable of 40 m": ("keypoints", lambda a: np.linspace(0, 1, 7)[:, None] * [40.0, 1.0] + np.zeros((21, 1, 1)),
                         r"the cable is 40\.01 m long, not 0\.01 to 10 m: is it in mm\?"),
    "points in one place": ("keypoints", lambda a: np.zeros((21, 7, 2)), "the cable is 0 m long"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG_NPZ)
def test_what_is_wrong_in_an_archive_is_said_with_its_array(tmp_path, name):
    arrays = cable(STEPS)
    key, change, said = WRONG_NPZ[name]
    nowhere(arrays, key, change(arrays))
    path = write(tmp_path / "r.npz", arrays)
    with pytest.raises(InputError, match=said) as caught:
        load_transitions(path)
    assert str(caught.value).startswith(f"{path}: ")


TWO = {"pixels": [[0, 0], [1, 0]], "table": [[0, 0], [1, 0]]}
LINE = {"pixels": [[0, 0], [1, 1], [2, 2]], "table": CORNERS[:3].tolist()}
CROSSED = {"pixels": SEEN[[0, 2, 1, 3]].tolist(), "table": CORNERS.tolist()}
WRONG_YAML: dict[str, tuple[dict[str, object], str]] = {
    "an unknown key": ({"unit": "mm"}, r"yaml:.: unit is not a known key; did you mean 'units'\?"),
    "an unknown unit": ({"units": "inch"}, "units must be m, cm, mm or px, got 'inch'"),
    "pixels of no size": ({"units": "px"}, "must have either scale or calibration if units are px"),
    "a scale of metres": ({"scale": 1e-3}, "must have either scale or calibration if units are px"),
    "a scale beside poses": ({"units": "px", "scale": 1e-3}, "gripper poses need a calibration"),
    "two points": ({"units": "px", "calibration": TWO}, "3 or 4 pairs of points, got 2 and 2"),
    "points in line": ({"units": "px", "calibration": LINE}, r"three of the points are in line: \(0, 0\), \(1, 1\), "),
    "corners in another order": ({"units": "px", "calibration": CROSSED}, "must be listed in the same order"),
    "an endless gap": ({"gap": 1e6}, r"gap must be from 0\.001 to 1 s"),
    "another file": ({"file": "r.yaml"}, "file must be the name of a CSV or NPZ file, got 'r.yaml'"),
    "no file": ({"file": "nowhere.npz"}, "no such file"),
    "a cable of another length": ({"cable": {"length": 0.9}}, "measures 298.6 mm .*cable.length says 900 mm"),
    "an unknown cable": ({"cable": {"preset": "chain"}}, "cable.preset must be one of cotton,"),
    "a later version": ({"cableway": 2}, "cableway is 2, but this release reads format version 1"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG_YAML)
def test_what_is_wrong_in_a_description_is_said(tmp_path, name):
    keys, said = WRONG_YAML[name]
    path = write(tmp_path / "r.npz", cable(STEPS))
    with pytest.raises(InputError, match=said):
        load_transitions(described(path, **keys))


def test_what_the_camera_does_not_see_is_refused(tmp_path):
    """Beyond the horizon of a slanted picture there is no table."""
    arrays = cable(STEPS)
    arrays["keypoints"] = np.full((21, 7, 2), [600.0, -9000.0])
    calibration = {"pixels": SEEN.tolist(), "table": CORNERS.tolist()}
    path = described(write(tmp_path / "r.csv", arrays), units="px", calibration=calibration)
    with pytest.raises(InputError, match="line 3: x0 is beyond the horizon"):
        load_transitions(path)


def test_an_archive_that_swells_is_refused_before_it_is_read(tmp_path):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (40_000_000,)})
    with zipfile.ZipFile(tmp_path / "r.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("times.npy", header.getvalue() + bytes(320_000_000))
    with pytest.raises(InputError, match="its arrays are larger than 256 MB"):
        load_transitions(tmp_path / "r.npz")


@pytest.mark.parametrize(
    "text",
    [
        ",".join(["time", *(f"x{k},y{k}" for k in range(200_000))]),
        ",".join([*(f"a{k}" for k in range(200_000)), "b", "b"]) + "\n",
        ",".join(f"a{k}" for k in range(1_000_000)) + "\n1" * 1_000_000,
        "time,x0,y0,x1,y1,x2,y2" + "\n" * 5_000_000,
    ],
    ids=["keypoints", "the last twice", "columns and rows", "nothing"],
)
def test_a_table_of_millions_is_refused_at_once(tmp_path, text):
    """Before anything is made as large as columns times rows, or looked up as often."""
    (tmp_path / "r.csv").write_text(text)
    begun = time.process_time()
    with pytest.raises(InputError) as caught:
        load_transitions(tmp_path / "r.csv")
    assert len(str(caught.value)) < 600
    assert time.process_time() - begun < 20, "a guard against what grows with the square"


def test_steps_beyond_memory_are_refused(tmp_path):
    """Rows that are far apart make ten times as many steps."""
    times = np.arange(9000.0)
    keypoints = np.zeros((9000, 200, 2)) + np.linspace(0, 0.3, 200)[:, None] * [1.0, 0.0]
    path = write(tmp_path / "r.npz", {"times": times, "keypoints": keypoints})
    with pytest.raises(InputError, match="more than 16,000,000 numbers"):
        load_transitions(described(path, gap=1.0))


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"PK\x03\x04" + bytes(99), b"\x00" * 50, b"time;x0;y0\n0;1;2\n"])
@pytest.mark.parametrize("name", ["r.csv", "r.npz", "r.yaml"])
def test_what_is_no_recording_is_refused_in_one_sentence(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError) as caught:
        load_transitions(tmp_path / name)
    assert len(str(caught.value)) < 500
    assert "\n" not in str(caught.value)


def test_an_angle_that_jumps_by_a_turn_is_interpolated_through_it(tmp_path):
    """As robots report angles; the rows are not at the steps, so that one step lies in the jump."""
    arrays = cable(np.arange(0.0, 3.0, 0.07))
    jumping = {name: array.copy() for name, array in arrays.items()}
    jumping["poses"][23:, 0, 2] += 2 * np.pi
    plain, found = (
        load_transitions(write(tmp_path / "a.npz", arrays)),
        load_transitions(write(tmp_path / "b.npz", jumping)),
    )
    np.testing.assert_allclose(found.actions, plain.actions, atol=1e-12)
