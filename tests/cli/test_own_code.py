"""Laws of `--plant` and `--controller` with a class of the user's own, and of `--from` with a plan of theirs."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from commands import Command

import cableway as cw
from cableway.core.errors import InputError
from cableway.outcome import Outcome
from cableway.records import Plan, Rollout

LAB = """
import numpy as np
import cableway as cw
from cableway.control.open_loop import OpenLoop
from cableway.records import Observation


class Bench:
    def __init__(self, task):
        self._cable = cw.CableSimulator(task)
        self.task, self.control_step, self.count = task, 0.1, 0
        self.reset, self.measure = self._cable.reset, self._cable.measure

    def step(self, action):
        self.count += 1
        return self._cable.step(action)


class Lost(Bench):
    def step(self, action):
        if self.count == 20:
            raise ConnectionError("the robot hung up")
        return super().step(action)


class Leaves(Bench):
    def step(self, action):
        raise SystemExit(0)


class Flat(Bench):
    def step(self, action):
        return Observation(0.1, np.zeros((3, 2)), np.zeros((2, 3)))


class Half:
    def __init__(self, task):
        self.task = task

    def reset(self):
        return None


class Slow(Bench):
    def __init__(self, task):
        super().__init__(task)
        self.control_step = 0.02


class Refuses:
    def __init__(self, task):
        raise OSError("no robot at this address")


class Mine(OpenLoop):
    pass


class Unready(OpenLoop):
    def init(self, task, plan):
        return None


def nothing():
    return 3
"""


@pytest.fixture
def lab(cableway: Command, tmp_path: Path) -> Iterator[Path]:
    """A package of the user's in the current folder."""
    path, before = sys.path.copy(), set(sys.modules)
    folder = tmp_path / "lab"
    folder.mkdir()
    (folder / "bench.py").write_text(LAB)
    (folder / "broken.py").write_text("import nothing_of_this_name")
    (folder / "leaves.py").write_text("import sys\nsys.exit(0)")
    yield folder
    sys.path[:] = path
    for name in set(sys.modules) - before:
        if name.partition(".")[0] == "lab":
            del sys.modules[name]


def follow(cableway: Command, run_folder: Path, task: Path, *options: object):
    return cableway("run", task, "--from", run_folder / "plan.npz", "--no-video", "--out", "o", *options)


def report() -> dict:
    return json.loads(Path("o/report.json").read_text())


def test_a_plan_from_a_file_is_followed(cableway: Command, moved_file: Path, run_folder: Path):
    """As Python follows it; the same run as the one that it was made in, and the folder of the plan stays as it is."""
    options = ("--controller", "open-loop", "--seed", 3, "--from", run_folder / "plan.npz", "--no-video", "--json")
    before = {path.name: path.read_bytes() for path in run_folder.iterdir()}
    done = cableway("run", moved_file, *options)
    assert done.status == 0
    assert f"The plan is that of {run_folder / 'plan.npz'}." in json.loads(done.out)["notes"]
    there = Path("runs/moved-plan")
    np.testing.assert_array_equal(Plan.load(there / "plan.npz").poses, Plan.load(run_folder / "plan.npz").poses)
    keypoints = Rollout.load(there / "rollout.npz").keypoints
    np.testing.assert_array_equal(keypoints, Rollout.load(run_folder / "rollout.npz").keypoints)
    chosen = cw.SolveOptions(controller="open-loop", plan=run_folder / "plan.npz", seed=3)
    run = cw.solve(cw.load_task(moved_file), chosen)
    assert run.rollout is not None
    np.testing.assert_array_equal(keypoints, run.rollout.keypoints)
    assert {path.name: path.read_bytes() for path in run_folder.iterdir()} == before


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--pivot", "grid"), "--pivot says how a plan is found, and --from {plan} gives one"),
        (("--time-limit", "5"), "--time-limit says how"),
        (("--planner", "slide"), "--planner says how"),
        (("--no-rehearsal",), "--no-rehearsal says how"),
        (("--out", "{folder}"), "{folder}: the plans in it would be replaced, {plan} among them"),
        (("--from", "none.npz"), "none.npz: no such file"),
        (("--tracker", "rod"), "--tracker rod finds a cable in pictures, and no --camera takes any"),
        (("--depth",), "--depth is of cameras, and no --camera takes pictures"),
        (("--camera", "above,below"), "unknown place of a camera 'below'"),
        (("--from", "circle.npz"), "'circle.npz': cannot be read: Too many levels of symbolic links"),
        (("--from", "{folder}/rollout.npz"), "rollout.npz: not a plan file: there is no array 'shapes'"),
    ],
)
def test_what_does_not_go_with_a_plan_from_a_file(
    cableway: Command, moved_file: Path, run_folder: Path, options: tuple[str, ...], said: str
):
    plan = run_folder / "plan.npz"
    Path("circle.npz").symlink_to("circle.npz")
    done = cableway("run", moved_file, "--from", plan, *(each.format(folder=run_folder) for each in options))
    assert done.status == 2
    assert said.format(plan=plan, folder=run_folder) in done.err
    assert not Path("runs").exists()


def test_a_plan_of_another_task_is_refused_with_the_first_check_that_fails(cableway: Command, run_folder: Path):
    plan = run_folder / "plan.npz"
    done = cableway("run", "single-obstacle-2", "--from", plan, "--quiet")
    assert (done.status, done.out) == (2, "")
    assert done.err.startswith(f"cableway: {plan}: not a verified plan of the task 'single-obstacle-2': ")
    assert "(least clearance " in done.err
    with pytest.raises(InputError, match=r"^the plan: not a verified plan of the task 'single-obstacle-2': "):
        cw.solve(cw.load_task("single-obstacle-2"), cw.SolveOptions(plan=Plan.load(plan)))
    assert not Path("runs").exists()


def test_the_plan_of_an_insertion_is_none_of_the_way_there(cableway: Command, run_folder: Path):
    plan = Plan.load(run_folder / "plan.npz")
    Plan(plan.shapes, plan.poses, metadata={"part": "insertion"}).save("plug.npz")
    done = cableway("run", "insertion", "--from", "plug.npz")
    assert (done.status, "plug.npz: the plan of an insertion" in done.err) == (2, True)


def test_a_plant_and_a_controller_of_ones_own(cableway: Command, moved_file: Path, run_folder: Path, lab: Path):
    """Both files are named before anything moves; the same figures as without, where they do the same."""
    own = ("--plant", "lab.bench:Bench", "--controller", "lab.bench:Mine", "--seed", 3)
    done = follow(cableway, run_folder, moved_file, *own)
    assert done.status == 0
    for what in ("controller lab.bench:Mine", "plant lab.bench:Bench"):
        assert f"The {what} runs {lab / 'bench.py'}." in done.err
    found, before = Rollout.load("o/rollout.npz"), Rollout.load(run_folder / "rollout.npz")
    np.testing.assert_array_equal(found.keypoints, before.keypoints)
    assert found.metadata["plant"] == {"own": "lab.bench:Bench", "file": str(lab / "bench.py")}
    assert found.metadata["controller"]["name"] == "Mine"
    assert any("lab.bench:Bench" in note for note in report()["notes"])
    assert cableway("check", moved_file, "o/rollout.npz").status == 0
    chosen = cw.SolveOptions(plan=run_folder / "plan.npz", plant="lab.bench:Bench", controller="lab.bench:Mine", seed=3)
    assert cw.solve(cw.load_task(moved_file), chosen).success


def test_a_dry_run_leaves_the_plant_alone(cableway: Command, moved_file: Path, run_folder: Path, lab: Path):
    done = follow(cableway, run_folder, moved_file, "--plant", "lab.bench:Refuses", "--dry-run")
    assert done.status == 0
    assert report()["notes"][0].startswith("Dry run: nothing was moved.")


@pytest.mark.parametrize(
    ("option", "name", "said"),
    [
        ("--plant", "lab.bench:Half", "lab.bench:Half: the plant, of type Half, lacks control_step, step(), measure()"),
        ("--plant", "lab.bench:Slow", "its control_step must be 0.1 s, got 0.02"),
        ("--plant", "lab.bench:Refuses", "OSError: no robot at this address (bench.py, line 52)"),
        ("--plant", "lab.bench:nothing", "no plant can be made of the task 'moved': TypeError: nothing() takes 0"),
        ("--plant", "lab.bench:Nope", "bench.py: has no 'Nope'; it has Bench, Lost, Leaves, Flat"),
        ("--plant", "sys:exit", "sys:exit: sys is built into Python; a module of your own is wanted"),
        ("--plant", "lab.none:Bench", "lab.none:Bench: there is no module 'lab.none', neither in "),
        ("--plant", "lab.broken:Bench", "No module named 'nothing_of_this_name' (broken.py, line 1)"),
        ("--plant", "lab.leaves:Bench", "the module failed to run: SystemExit: 0 (leaves.py, line 2)"),
        ("--plant", "lab-x:Bench", "lab-x:Bench: must be package.module:NAME or FILE.py:NAME"),
        ("--controller", "lab.bench:Bench", "no controller can be made: TypeError: Bench.__init__() missing 1"),
        ("--controller", "lab.bench:nothing", "must make a cableway.control.base.Controller with a config, got int"),
    ],
)
def test_what_is_no_plant_or_controller(
    cableway: Command, moved_file: Path, run_folder: Path, lab: Path, option: str, name: str, said: str
):
    done = follow(cableway, run_folder, moved_file, option, name, "--quiet")
    assert done.status == 2
    assert said in done.err
    assert done.err.count("\n") == 1
    assert not Path("o").exists()


@pytest.mark.parametrize(
    ("option", "name", "outcome", "said"),
    [
        (
            "--plant",
            "Lost",
            Outcome.PLANT_FAILED,
            "the plant's step raised ConnectionError: the robot hung up (bench.py, line 22)",
        ),
        ("--plant", "Leaves", Outcome.PLANT_FAILED, "the plant's step raised SystemExit: 0 (bench.py, line 28)"),
        ("--plant", "Flat", Outcome.PLANT_FAILED, "the plant's step reported keypoints of shape (3, 2), not (13, 2)"),
        ("--controller", "Unready", Outcome.CONTROLLER_FAILED, "init() must return a ControllerState, got None"),
    ],
)
def test_what_fails_on_the_way_ends_the_run_with_a_report(
    cableway: Command, moved_file: Path, run_folder: Path, lab: Path, option: str, name: str, outcome: str, said: str
):
    done = follow(cableway, run_folder, moved_file, option, f"lab.bench:{name}", "--quiet")
    assert (done.status, done.err) == (1, "")
    assert report()["outcome"] == outcome
    assert said in report()["failure"]


def test_a_perturbation_is_not_of_another_plant():
    noise = cw.Perturbation(sensing=cw.SensingConfig(keypoint_noise=0.001))
    with pytest.raises(InputError, match="a perturbation is of the simulated plant"):
        cw.SolveOptions(plant=cw.CableSimulator, perturbation=noise)
