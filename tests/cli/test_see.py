"""Laws of `see` and `calibrate`: pictures in, a recording and a camera out."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from commands import Command

from cableway.core.errors import InputError
from cableway.datasets.recordings import load_recording
from cableway.figures.film import write_film
from cableway.perception import markers
from cableway.perception.calibration_file import load_camera, save_camera
from cableway.perception.capture import Frame
from cableway.perception.placement import camera_at
from cableway.perception.segmentation import CableColor
from cableway.rendering.markers import BAND
from cableway.rendering.mesh import Mesh, prism, tube
from cableway.rendering.picture import Light, render
from cableway.rod.inverse import shape_between
from cableway.scene.cable import Cable
from cableway.workflow.seeing import Eye, GripperLog, see

cv2 = pytest.importorskip("cv2")

CABLE = Cable()
POSES = np.array([[0.2, 0.3, 0.5], [0.42, 0.3, -0.5]])
STEPS = 5


def shape(k: int) -> np.ndarray:
    poses = POSES + [0.01 * k, 0.0, 0.0]
    return CABLE.rod.shapes(shape_between(CABLE.rod, poses, "left")[None])[0][0]


@cache
def taken(k: int, place: str, banded: bool = False) -> np.ndarray:
    """The picture of the cable in a step, by a camera somewhere; with green bands at its inner keypoints."""
    table = prism(np.array([[-0.2, -0.2], [0.9, -0.2], [0.9, 0.9], [-0.2, 0.9]]), (-0.01, 0.0)).painted((0.9,) * 3, 1)
    line = np.column_stack([shape(k), np.full(len(shape(k)), CABLE.radius)])
    bands = [
        tube(line[at - 1 : at + 2], BAND * CABLE.radius).painted((0.05, 0.55, 0.2), 5)
        for at in range(CABLE.rod.stride, len(line) - 1, CABLE.rod.stride)
        if banded
    ]
    mesh = Mesh.joined([table, tube(line, CABLE.radius).painted((0.85, 0.35, 0.05), 4), *bands])
    camera = camera_at(place, (0.7, 0.7))
    return render(mesh, camera.pinhole, Light(position=(0.3, 0.3, 2.0), shadows=0)).color


@pytest.fixture
def film(tmp_path: Path) -> Path:
    """A folder of pictures of a cable that moves, and the file of their camera."""
    return pictures(tmp_path)


def pictures(tmp_path: Path, banded: bool = False) -> Path:
    camera, folder = camera_at("above", (0.7, 0.7)), tmp_path / "film"
    folder.mkdir()
    for k in range(STEPS):
        image = taken(k, "above", banded)
        cv2.imwrite(str(folder / f"{k:03d}.png"), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    save_camera(tmp_path / "camera.json", camera)
    return folder


def grippers(path: Path) -> Path:
    head = "time,left_x,left_y,left_theta,right_x,right_y,right_theta\n"
    rows = [",".join(map(str, [0.1 * k, *(POSES + [0.01 * k, 0.0, 0.0]).ravel()])) for k in range(STEPS)]
    path.write_text(head + "\n".join(rows) + "\n")
    return path


def test_what_was_there_before_is_not_the_cable(cableway: Command, film: Path, tmp_path: Path):
    """Another cable lies beside it: with a picture of that alone the cable is found where it is."""
    empty = np.full_like(taken(0, "above"), 220)
    for path in sorted(film.iterdir()):
        image = cv2.imread(str(path))
        assert image is not None
        image[100:400, 500:505] = empty[100:400, 500:505] = (13, 89, 217)
        cv2.imwrite(str(path), image)
    cv2.imwrite(str(tmp_path / "empty.png"), empty)
    found = {}
    for name, more in {"with": ("--background", "empty.png"), "without": ()}.items():
        options = ("--calibration", "camera.json", "--color", "217,89,13", "--out", name, *more)
        cableway("see", str(film), *options)
        rows = np.genfromtxt(tmp_path / name / "keypoints.csv", delimiter=",", skip_header=1)[:, 1:27]
        found[name] = rows.reshape(STEPS, 13, 2)
    true = CABLE.rod.at_keypoints(shape(0)[None])[0]

    def off(keypoints: np.ndarray) -> float:
        return float(np.nanmax(np.linalg.norm(keypoints[0][:, None] - true, axis=2).min(axis=1)))

    assert off(found["with"]) < 0.02
    assert not off(found["without"]) < 0.02, "the other one is taken for it"


@pytest.mark.parametrize("by_grippers", [False, True])
def test_keypoints_of_a_film_are_a_recording(cableway: Command, tmp_path: Path, film: Path, by_grippers: bool):
    """To 1 mm with gripper poses; by the pixels alone, ends in shadow are cut by a little."""
    options = ["--calibration", tmp_path / "camera.json", "--color", "217,89,13", "--rate", "10", "--out", "seen"]
    options += ["--grippers", grippers(tmp_path / "grippers.csv")] if by_grippers else ["--live", "0"]
    done = cableway("see", film, *options)
    assert done.status == 0, done.err
    assert ("The pictures are at http://127.0.0.1:" in done.out + done.err) == (not by_grippers)
    found = np.genfromtxt("seen/keypoints.csv", delimiter=",", names=True)
    keypoints = np.array([[found[f"x{n}"], found[f"y{n}"]] for n in range(13)]).transpose(2, 0, 1)
    truth = np.array([CABLE.rod.at_keypoints(shape(k)[None])[0] for k in range(STEPS)])
    assert np.linalg.norm(keypoints - truth, axis=2).max() < (0.001 if by_grippers else 0.006)
    assert json.loads(Path("seen/report.json").read_text())["known"] == STEPS
    assert cv2.VideoCapture("seen/overlay.mp4").get(cv2.CAP_PROP_FRAME_COUNT) == STEPS
    assert len(load_recording(Path("seen/keypoints.csv"))) == STEPS - 1


def by_markers(tmp_path: Path, *options: str) -> list[str]:
    """Arguments of `see` for a film of a banded cable."""
    camera, poses = tmp_path / "camera.json", grippers(tmp_path / "grippers.csv")
    given = ["--calibration", camera, "--grippers", poses, "--rate", "10", "--out", "seen", "--tracker", "markers"]
    return [str(each) for each in (pictures(tmp_path, banded=True), *given, "--color", "13,140,51", *options)]


@pytest.mark.parametrize("between", [(), ("--cable-color", "217,89,13")])
def test_markers_are_found_in_a_film(cableway: Command, tmp_path: Path, between: tuple[str, ...]):
    done = cableway("see", *by_markers(tmp_path, *between))
    assert done.status == 0, done.err
    found = np.genfromtxt("seen/keypoints.csv", delimiter=",", names=True)
    keypoints = np.array([[found[f"x{n}"], found[f"y{n}"]] for n in range(13)]).transpose(2, 0, 1)
    truth = np.array([CABLE.rod.at_keypoints(shape(k)[None])[0] for k in range(STEPS)])
    assert np.linalg.norm(keypoints - truth, axis=2).max() < 0.001


@pytest.mark.parametrize("between", [(), ("--cable-color", "217,89,13")])
def test_where_no_marker_is_found_a_cable_is_by_its_colour_if_that_is_given(
    cableway: Command, tmp_path: Path, between: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(markers, "SMALLEST", np.inf)
    done = cableway("see", *by_markers(tmp_path, *between))
    assert json.loads(Path("seen/report.json").read_text())["known"] == (STEPS if between else 0)
    assert done.status == (0 if between else 1)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("none", "--color", "1,2,3"), "none: no such file, folder or number of a camera"),
        (("film", "--color", "red"), "--color must be three numbers"),
        (("film", "--color", "1,2,3", "--rate", "0"), "--rate must be above 0"),
        (("film", "--color", "1,2,3", "--seconds", "-1"), "--seconds must be above 0"),
        (("film", "--color", "1,2,3", "--calibration", "none.json"), "none.json"),
        (("film,film", "--color", "1,2,3"), "--calibration must be one for each of 2 sources, got camera.json"),
        (("film", "--color", "1,2,3", "--hides", "a.png,b.png"), "--hides must be one for each of 1 sources"),
        (("film", "--color", "1,2,3", "--hides", "none.png"), "none.png: not a picture"),
        (("film", "--color", "1,2,3", "--tracker", "markers"), "--tracker markers needs --grippers"),
        (("film", "--color", "1,2,3", "--cable-color", "1,2,3"), "--cable-color needs --tracker markers"),
        (
            ("film", *["--color", "1,2,3", "--tracker", "markers", "--grippers", "g.csv", "--cable-color", "red"]),
            "--cable-color must be three numbers",
        ),
        (("film", "--color", "1,2,3", "--tracker", "eyes"), "unknown tracker 'eyes'; known: markers, rod"),
        (("film", "--color", "1,2,3", "--grippers", "camera.json"), "there is no column 'time'"),
    ],
)
def test_what_cannot_be_seen_is_told(cableway: Command, tmp_path: Path, film: Path, arguments, said: str, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = cableway("see", "--calibration", "camera.json", *arguments)
    assert done.status == 2
    assert said in done.err


def test_a_table_where_the_cable_should_be_counts_unless_something_is_known_to_hide_it():
    """One half of the cable is covered in the picture of one camera; the other camera sees all of it."""
    camera, image = camera_at("above", (0.7, 0.7)), taken(0, "above")
    covered = np.zeros(image.shape[:2], bool)
    covered[:, image.shape[1] // 2 :] = True
    bare = np.where(covered[..., None], np.uint8(230), image)
    log = GripperLog(np.zeros(1), POSES[None])

    def known(*eyes: Eye) -> bool:
        return next(see(eyes, CableColor(color=(217, 89, 13)), CABLE, log)).known

    def half_covered(hides: list[np.ndarray] | None) -> Eye:
        return Eye(camera, [Frame(0.0, bare)], hides)

    front = Eye(camera_at("front", (0.7, 0.7)), [Frame(0.0, taken(0, "front"))], [np.zeros_like(covered)])
    assert known(half_covered(None)), "it is not known whether something hides it"
    assert known(half_covered([covered]))
    assert not known(half_covered([np.zeros_like(covered)]))
    assert known(half_covered([covered]), front)
    with pytest.raises(InputError, match="a mask of what hides the cable is 2 x 2 pixels"):
        known(half_covered([np.zeros((2, 2), bool)]))


def test_two_cameras_and_a_mask_on_the_command_line(cableway: Command, tmp_path: Path, film: Path):
    front, options = tmp_path / "front", ["--color", "217,89,13", "--rate", "10", "--out", "seen"]
    front.mkdir()
    for k in range(STEPS):
        cv2.imwrite(str(front / f"{k:03d}.png"), cv2.cvtColor(taken(k, "front"), cv2.COLOR_RGB2BGR))
    save_camera(tmp_path / "front.json", camera_at("front", (0.7, 0.7)))
    cv2.imwrite(str(tmp_path / "nothing.png"), np.zeros((480, 640), np.uint8))
    files = [",".join(str(tmp_path / name) for name in names) for names in
             (("film", "front"), ("camera.json", "front.json"), ("nothing.png", "nothing.png"))]  # fmt: skip
    options += ["--calibration", files[1], "--hides", files[2], "--grippers", grippers(tmp_path / "grippers.csv")]
    done = cableway("see", files[0], *options)
    assert done.status == 0, done.err
    assert json.loads(Path("seen/report.json").read_text())["known"] == STEPS
    assert cv2.VideoCapture("seen/overlay.mp4").get(cv2.CAP_PROP_FRAME_WIDTH) == 2 * 640

    slow = f"{tmp_path / 'film'},{tmp_path / 'slow.mp4'}"
    write_film(tmp_path / "slow.mp4", 5.0, [taken(0, "front")] * 3)
    done = cableway("see", slow, *options)
    assert (done.status, "as many pictures per second, got 10 and 5" in done.err) == (2, True)


def test_a_camera_in_a_file_is_the_same(tmp_path: Path, film: Path):
    camera, read = camera_at("above", (0.7, 0.7)), load_camera(tmp_path / "camera.json")
    np.testing.assert_allclose(read.pinhole.pose, camera.pinhole.pose, atol=1e-12)
    assert read.pinhole.focal == camera.pinhole.focal


def test_calibrate_says_what_it_needs(cableway: Command, film: Path):
    done = cableway("calibrate", film, "--table", film / "000.png", "--board", "7")
    assert (done.status, "--board must be 2 numbers" in done.err) == (2, True)
    done = cableway("calibrate", film, "--table", film / "000.png")
    assert (done.status, f"0 of {STEPS + 1} pictures show" in done.err) == (2, True)


def test_a_colour_between_markers_needs_markers():
    orange, eye = CableColor(color=(217, 89, 13)), Eye(camera_at("above", (0.7, 0.7)), [Frame(0.0, taken(0, "above"))])
    with pytest.raises(InputError, match="a cable between its markers, and the tracker is 'rod'"):
        next(see([eye], orange, CABLE, cable_color=orange))
