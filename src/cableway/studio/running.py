"""A run that is watched: what it is asked for, and how far it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from cableway.core.configuration import from_mapping
from cableway.core.errors import InputError, Point, UnknownNameError
from cableway.core.quantities import quantity
from cableway.geometry.spatial_convex import chain_distance
from cableway.motion.spatial import SpatialBodies
from cableway.records import Measurement, Plan, Rollout
from cableway.scene.files.loading import AnyTask
from cableway.scene.scene import Scene
from cableway.scene.spatial.scene import SpatialScene, recorded_displacements
from cableway.scene.spatial.task import SpatialTask
from cableway.scene.task import CONTROL_STEP, Task
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.perturbations.variants import VARIANTS, named_perturbation
from cableway.simulation.spatial_perturbation import SpatialPerturbation
from cableway.studio.replanner import Answer
from cableway.tracking import Row
from cableway.tracking.photographer import EyesConfig
from cableway.workflow.registry import DEFAULT_CONTROLLER
from cableway.workflow.run import Run, SolveOptions
from cableway.workflow.solve_in_space import SpatialOptions, SpatialRun

PLANTS = tuple(name for name in VARIANTS if name != "drawn")
"""Names of the plants to choose from; that which draws from a preset's ranges asks for a preset."""

CAMERAS = {
    "none": (),
    **{
        ", ".join(places): places
        for places in (("above", "back"), ("front", "back"), ("left", "right"), ("above",), ("front",))
    },
}
"""Cameras to choose from, by what they are called."""

SPATIAL_PLANTS = (PLANTS[0], "drawn")
"""The same in space: the task's cable, and one drawn by `SpatialPerturbation.drawn`."""


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """What a run is asked for.

    Attributes:
        controller: Name of the controller.
        plant: Name of the plant, one of `PLANTS`.
        stiffness: Factor on the bending stiffness of the plant's cable.
        length: Factor on its length.
        friction: Its coefficient on the table; None for the plant's.
        noise: Of keypoints [m]; None for the plant's.
        delay: Of keypoints [s]; None for the plant's.
        cameras: By whose pictures alone the cable is known, on the table; none where the plant gives keypoints.
    """

    controller: str = DEFAULT_CONTROLLER
    plant: str = PLANTS[0]
    stiffness: float = 1.0
    length: float = 1.0
    friction: float | None = None
    noise: float | None = None
    delay: float | None = None
    cameras: tuple[str, ...] = ()

    def eyes(self, task: AnyTask, seed: int) -> EyesConfig | None:
        """The cameras, as those of `cableway run --camera` with that seed."""
        return EyesConfig(cameras=self.cameras, seed=seed) if self.cameras and isinstance(task, Task) else None

    def perturbation(self, task: AnyTask, seed: int) -> Perturbation | SpatialPerturbation:
        """How the plant differs from the task.

        Raises:
            UnknownNameError: There is no such plant; the message lists them.
            InputError: A value is out of range, or the plant does not fit the task.
        """
        return self._in_space(task, seed) if isinstance(task, SpatialTask) else self._on_table(task, seed)

    def _in_space(self, task: SpatialTask, seed: int) -> SpatialPerturbation:
        if self.plant not in SPATIAL_PLANTS:
            raise UnknownNameError("plant in space", self.plant, SPATIAL_PLANTS)
        found = SpatialPerturbation() if self.plant == SPATIAL_PLANTS[0] else SpatialPerturbation.drawn(task, seed)
        cable, config = found.cable or task.cable, found.config
        changed = replace(
            cable, bending_stiffness=self.stiffness * cable.bending_stiffness, length=self.length * cable.length
        )
        delay = config.measurement_delay if self.delay is None else round(self.delay / CONTROL_STEP)
        config = replace(
            config,
            friction=config.friction if self.friction is None else self.friction,
            keypoint_noise=config.keypoint_noise if self.noise is None else self.noise,
            measurement_delay=delay,
        )
        return replace(found, cable=None if changed == task.cable else changed, config=config)

    def _on_table(self, task: Task, seed: int) -> Perturbation:
        found = named_perturbation(self.plant, task, seed)
        cable, sensing = found.true_cable(task), found.sensing
        changed = replace(
            cable,
            bending_stiffness=self.stiffness * cable.bending_stiffness,
            length=self.length * cable.length,
            friction=cable.friction if self.friction is None else self.friction,
        )
        if changed != cable:
            found = replace(found, cable=changed)
        sensed = replace(
            sensing,
            keypoint_noise=sensing.keypoint_noise if self.noise is None else self.noise,
            measurement_delay=sensing.measurement_delay if self.delay is None else self.delay,
        )
        found = replace(found, sensing=sensed)
        found.true_task(task)  # checks it
        return found


@dataclass(frozen=True, kw_only=True)
class Running:
    """How far a run is.

    Attributes:
        task: What is run.
        plan: What is followed; None where that is not known.
        controller: What follows.
        perturbation: How the plant differs from the task.
        eyes: The cameras by which the cable is known; None where there are none.
        rows: So far.
        sentence: What it is at, or how it ended.
        run: All there is of it, once it is over.
        rollout: What was recorded.
        kept: Rows seen before it was begun anew, for something that was pushed; shown until `rows` is as long.
        live: Whether it goes on.
    """

    task: AnyTask
    plan: Plan | None
    controller: Any = DEFAULT_CONTROLLER
    perturbation: Perturbation | SpatialPerturbation = field(default_factory=Perturbation)
    eyes: EyesConfig | None = None
    rows: tuple[Row, ...] = ()
    sentence: str = "The run begins ..."
    run: Run | SpatialRun | None = None
    rollout: Rollout | None = None
    kept: tuple[Row, ...] = ()
    live: bool = True

    @classmethod
    def of_rollout(cls, task: AnyTask, plan: Plan | None, rollout: Rollout, name: str) -> Running:
        """A run that was recorded in the file of that name."""
        plant = rollout.metadata.get("plant", {})
        where: Any = Perturbation(
            obstacles=tuple(tuple(each) for each in plant.get("obstacles", ())),
            pegs=tuple(tuple(each) for each in plant.get("pegs", ())),
        )
        if isinstance(task, SpatialTask):
            where = SpatialPerturbation(obstacles=recorded_displacements(rollout.metadata))
        rows, eyes = _rows(rollout), rollout.metadata.get("eyes")
        told = f"{name}: {rollout.outcome}{f' ({rollout.detail})' if rollout.detail else ''}."
        return cls(
            task=task, plan=plan, perturbation=where, eyes=eyes and _recorded(eyes, name), rows=rows, sentence=told,
            rollout=rollout, live=False,
        )  # fmt: skip

    @property
    def seen(self) -> tuple[Row, ...]:
        """The rows to show."""
        return self.rows if len(self.rows) >= len(self.kept) else self.kept

    @property
    def scene(self) -> Scene | SpatialScene:
        """Where the obstacles truly are."""
        task, perturbation = self.task, self.perturbation
        if isinstance(perturbation, SpatialPerturbation):
            assert isinstance(task, SpatialTask)
            return perturbation.true_task(task).scene
        assert isinstance(task, Task)
        return perturbation.known_task(task).scene

    def options(self, others: SolveOptions) -> SolveOptions | SpatialOptions:
        """What makes the run, by `workflow.solve.solve`, or in space by `workflow.solve_in_space`."""
        if isinstance(self.perturbation, SpatialPerturbation):
            return SpatialOptions(
                plan=self.plan, controller=self.controller, perturbation=self.perturbation, seed=others.seed
            )
        return replace(
            others, track=True, alternatives=1, plan=self.plan, controller=self.controller,
            perturbation=self.perturbation, eyes=self.eyes,
        )  # fmt: skip

    def heard(self, answer: Answer) -> Running:
        """One answer on."""
        if answer.row is not None:
            rows, row = (*self.rows, answer.row), answer.row
            told = f"{row.time:.1f} s: {row.status or 'at the start'}" if len(rows) >= len(self.kept) else self.sentence
            return replace(self, rows=rows, sentence=told)
        if answer.stage:
            return self if self.seen else replace(self, sentence=f"The run begins: {answer.stage} ...")
        run = answer.run
        if run is None:
            return replace(self, sentence=f"No run: {answer.problem}.", live=False)
        told = "Success." if run.success else f"{run.report.failure or run.report.outcome.sentence}."
        return replace(self, run=run, rollout=run.rollout, sentence=told[0].upper() + told[1:], live=False)

    def pushed(self, index: int, by: Point) -> Running:
        """The same run, an obstacle pushed by (dx, dy) [m] now; it is to be begun anew.

        The obstacle stands there from the start, and the controller learns of it now: a file holds that, and until now
        nothing is different, since nothing has been at that place.

        Raises:
            InputError: It cannot stand there, something has been there, or it is not the first push of this run.
        """
        if not self.live or not self.rows:
            raise InputError("no run is under way: an obstacle is pushed while there is one")
        perturbation: Any = self.perturbation
        if perturbation.obstacles or getattr(perturbation, "pegs", ()):
            raise InputError("one push a run: a file holds where obstacles are, and from when on that is known")
        more = (0.0,) if isinstance(self.task, SpatialTask) else ()
        moved: Any = [(0.0, 0.0, *more)] * len(self.task.scene.obstacles)
        moved[index] = (float(by[0]), float(by[1]), *more)
        pushed = replace(self.perturbation, obstacles=tuple(moved), revealed=self.rows[-1].time)
        room = replace(self, perturbation=pushed).room_at(index)
        if room < 0:
            raise InputError(f"cable or grippers have been there: it would overlap them by {quantity(-room)}")
        anew = "The obstacle is pushed: the run begins anew, up to here ..."
        return replace(self, perturbation=pushed, rows=(), kept=self.seen, sentence=anew)

    def room_at(self, index: int) -> float:
        """Least distance [m] of cable and grippers, so far, from where an obstacle truly is.

        Raises:
            InputError: It cannot be there.
        """
        task, scene = self.task, self.scene
        alone: Any = replace(scene, obstacles=(scene.obstacles[index],))
        lines = np.stack([row.measured.centreline for row in self.rows])
        poses = np.stack([row.measured.poses for row in self.rows])
        if isinstance(task, SpatialTask):
            bodies = SpatialBodies.of(task.bodies, task.cable.radius)
            cable = float(chain_distance(lines, alone.world)[0].min()) - task.cable.radius
            return min(cable, float(bodies.gaps(poses, alone.world)[:, 0].min()))
        cable = float(alone.clearance(lines, task.cable.radius).min())
        return min(cable, float(alone.signed_distance(poses[..., :2]).min()) - task.grippers.radius)


def _recorded(eyes: Mapping[str, Any], name: str) -> EyesConfig:
    """The cameras of a rollout in the file of that name.

    Raises:
        InputError: They are none that this version has.
    """
    known = {each.name for each in fields(EyesConfig)}
    return from_mapping(EyesConfig, {key: value for key, value in eyes.items() if key in known}, f"{name}: eyes")


def _rows(rollout: Rollout) -> tuple[Row, ...]:
    """The rows of a rollout, as they came."""
    rows: list[Row] = []
    for k, time in enumerate(rollout.times):
        measured = Measurement(
            keypoints=rollout.keypoints[k],
            poses=rollout.poses[k],
            centreline=rollout.centreline[k],
            clearance=float(rollout.clearance[k]),
            gripper_clearance=float(rollout.gripper_clearance[k]),
            joints=None if rollout.joints is None else rollout.joints[k],
        )
        status = str(rollout.status[k - 1]) if k else ""
        rows.append(Row(float(time), rollout.observed[k], measured, rollout.reference[k], status))
    return tuple(rows)
