"""The records that pass from stage to stage, in pipeline order.

Task -> Plan (+ Verdict) -> Rollout -> Report. Records hold arrays and scalars only. A record with `save` and `load`
goes to an `.npz` file; nothing in such a file is ever executed. Two records are equal where they are the same one:
arrays have no truth value.

Units are metres, radians and seconds throughout; T is the number of plan steps, K of control steps, n of keypoints.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np
from jaxtyping import Float

from cableway.core.brief import Brief, Shown, notebook
from cableway.core.errors import FileFormatError, InputError, Point
from cableway.core.files import ArrayRecord, check_shapes
from cableway.core.quantities import quantity
from cableway.estimate import Estimate as Estimate
from cableway.outcome import Outcome
from cableway.rod.held_rod import HeldRod
from cableway.scene.files.loading import TaskSource
from cableway.verdict import Check as Check
from cableway.verdict import Verdict as Verdict


# ------------------------------------------------------------------------------------------------ planning
@dataclass(frozen=True)
class Passage:
    """The shortest segment between two obstacles, where free space narrows.

    Attributes:
        ends: (2, 2) [m]: a point on each obstacle's surface.
        between: Indices of the two obstacles in the scene; walls follow the obstacles (left, bottom, right, top).
    """

    ends: Float[np.ndarray, "2 2"]
    between: tuple[int, int]

    @property
    def width(self) -> float:
        """[m]."""
        return float(np.linalg.norm(self.ends[1] - self.ends[0]))


@dataclass(frozen=True, eq=False, repr=False)
class PaperStages(Brief):
    """What the planning chain of Tang et al. (`cableway.tang2025`) made on the way to a plan.

    Attributes:
        pivot: (P, 2) pivot path [m].
        passages: (Q, 2, 2) ends of the passages that the pivot path traverses, in that order [m].
        path_set: (n, M, 2) keypoint paths [m].
        progress: (T+1, n) sigma of each keypoint along its path, 0 at the start, 1 at the goal, never falling.
        metadata: How it was made, for that of the plan: `ipopt` has status, iterations and whether it converged.
    """

    pivot: Float[np.ndarray, "P 2"]
    passages: Float[np.ndarray, "Q 2 2"]
    path_set: Float[np.ndarray, "n M 2"]
    progress: Float[np.ndarray, "T+1 n"]
    metadata: dict[str, Any] = field(default_factory=dict, kw_only=True)

    def __post_init__(self) -> None:
        check_shapes(self)
        _require_finite(self, *_STAGES)


_STAGES = ("pivot", "passages", "path_set", "progress")

INSERTION = "insertion"
"""Value of `metadata["part"]` of a plan and a rollout that insert a plug into its port."""

THEN_FAILED = "; then the plant failed"
"""How the last status of a rollout ends whose next step failed."""


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Shown, ArrayRecord):
    """A verified sequence of shapes with the gripper poses that make them; one row per control step.

    In a file the arrays of `stages` lie beside the others.

    Attributes:
        shapes: (T+1, n, 2) keypoints [m]; in space (T+1, n, 3).
        poses: (T+1, 2, 3) gripper poses (x, y, theta) [m, m, rad], left then right; angles run on without jumps. In
            space (T+1, 2, 7): position and unit quaternion (w, x, y, z), whose sign does not jump.
        q: (T+1, dof) rod coordinates of the shapes; None where the shapes are no equilibria, or not known to be.
        stages: What only the paper's planner makes; None for every other plan.
        metadata: How it was made: initial trajectory, seed, versions and the resolved configuration.
        joints: (T+1, 2, j) joint angles [rad] of the arms of a cell that hold the grippers, running on without jumps.
        approach: (A+1, 2, j) the same that lower open hands to the cable, up to the first row of `joints`.
        retreat: (R+1, 2, j) the same that raise them, from the last row on.
        verdict: What the search that made it found of it; None of any other plan, such as one from a file. It is not
            saved, and `dataclasses.replace` leaves it behind: what was changed is to be verified again.
    """

    kind: ClassVar[str] = "plan"

    shapes: Float[np.ndarray, "T+1 n space"]
    poses: Float[np.ndarray, "T+1 2 pose"]
    q: Float[np.ndarray, "T+1 dof"] | None = None
    stages: PaperStages | None = None
    metadata: dict[str, Any] = field(default_factory=dict)
    joints: Float[np.ndarray, "T+1 2 j"] | None = field(default=None, kw_only=True)
    approach: Float[np.ndarray, "A+1 2 j"] | None = field(default=None, kw_only=True)
    retreat: Float[np.ndarray, "R+1 2 j"] | None = field(default=None, kw_only=True)
    verdict: Verdict | None = field(default=None, init=False, compare=False)

    def __post_init__(self) -> None:
        check_shapes(self)
        rows = len(self.shapes)
        _require_sizes(self.shapes, self.poses)
        _require(rows >= 2, f"a plan needs at least 2 rows, got {rows}")
        _require_finite(self, "shapes", "poses", "q", "joints", "approach", "retreat")
        if self.stages is not None:
            expected, found = self.shapes.shape[:2], self.stages.progress.shape
            _require(found == expected, f"progress has shape {found}, not {expected}")

    @classmethod
    def of(cls, rod: HeldRod, q: Float[np.ndarray, "T+1 dof"], metadata: Mapping[str, Any] | None = None) -> Self:
        """The plan of a rod through shapes with these coordinates."""
        stations, poses = rod.shapes(q)
        return cls(np.ascontiguousarray(rod.at_keypoints(stations)), poses, q, metadata=dict(metadata or {}))

    @property
    def steps(self) -> int:
        """T, the number of control steps."""
        return len(self.shapes) - 1

    def judged(self, verdict: Verdict | None) -> Plan:
        """This plan with the verdict on it."""
        plan = replace(self)
        object.__setattr__(plan, "verdict", verdict)
        return plan

    def noted(self, **metadata: Any) -> Plan:
        """This plan, verdict included, with more metadata."""
        return replace(self, metadata={**self.metadata, **metadata}).judged(self.verdict)

    def _facts(self) -> Iterator[str]:
        yield f"{self.steps} steps"
        yield from super()._facts()

    def to_arrays(self) -> dict[str, Any]:
        """See `ArrayRecord.to_arrays`."""
        arrays = super().to_arrays()
        stages = arrays.pop("stages", None)
        return arrays if stages is None else arrays | {name: getattr(stages, name) for name in _STAGES}

    @classmethod
    def from_arrays(cls, arrays: dict[str, np.ndarray], source: str) -> Self:
        """See `ArrayRecord.from_arrays`."""
        plan = super().from_arrays({name: array for name, array in arrays.items() if name != "stages"}, source)
        if any(name not in arrays for name in _STAGES):
            return plan
        try:
            return replace(plan, stages=PaperStages(*(arrays[name] for name in _STAGES)))
        except InputError as error:
            raise FileFormatError(f"{source}: {error}") from None


@dataclass(frozen=True, eq=False, repr=False)
class Attempt(Brief):
    """A plan that did not verify, for pictures and reports only.

    Attributes:
        reason: One sentence.
        shapes: (T+1, n, 2) [m] shapes reached, in space (T+1, n, 3), or None.
        poses: (T+1, 2, 3) gripper poses of the shapes, in space (T+1, 2, 7), or None.
        verdict: What failed, if it came that far.
        stages: What the paper's planner made on the way, or None.
        at: Where on the table [m] the reason is to be found, or None.
    """

    reason: str
    shapes: Float[np.ndarray, "T+1 n space"] | None = None
    poses: Float[np.ndarray, "T+1 2 pose"] | None = None
    verdict: Verdict | None = None
    stages: PaperStages | None = None
    at: Point | None = None


# ------------------------------------------------------------------------------------------------ control
@dataclass(frozen=True, eq=False, repr=False)
class RodParameters(Brief):
    """What is known of the parameters of a rod, in the order of `rod.material.NAMES`.

    Attributes:
        mean: (p,) of them.
        covariance: (p, p), in their units.
    """

    mean: Float[np.ndarray, "p"]
    covariance: Float[np.ndarray, "p p"]


@dataclass(frozen=True, eq=False, repr=False)
class Observation(Brief):
    """What a controller sees at one control step.

    Attributes:
        time: [s] since the start of the run.
        keypoints: (n, 2) measured keypoints [m], NaN where nothing was observed; in space (n, 3).
        poses: (2, 3) measured gripper poses [m, m, rad]; in space (2, 7).
        taken: [s] when the frame was taken, on the same clock as `time`; None where unknown, it is then estimated.
        confidence: (n,) from 0 (not observed) to 1, by which each keypoint counts; None where all count the same. Where
            all are 0 the grippers stand still, and while an observed one is below 0.13 the cable has not settled.
        rod: Parameters of the cable as a tracker estimates them from pictures; a controller takes these in place of an
            estimate of its own. None where keypoints are all that is known.
    """

    time: float
    keypoints: Float[np.ndarray, "n space"]
    poses: Float[np.ndarray, "2 pose"]
    taken: float | None = None
    confidence: Float[np.ndarray, "n"] | None = None
    rod: RodParameters | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Measurement(Brief):
    """What a plant that knows the truth reports after one control step; for the record, not for controllers.

    Attributes:
        keypoints: (n, 2) true keypoints [m]; in space (n, 3).
        poses: (2, 3) true gripper poses [m, m, rad]; in space (2, 7).
        centreline: (M, 2) the whole cable [m]; in space (M, 3).
        clearance: Least clearance [m] of the cable's surface during the step, negative by the penetration.
        gripper_clearance: Least clearance [m] of grippers, and of arms that carry them, during the step.
        joints: (2, j) joint angles [rad] of these arms, left then right; None where there are none.
    """

    keypoints: Float[np.ndarray, "n space"]
    poses: Float[np.ndarray, "2 pose"]
    centreline: Float[np.ndarray, "M space"]
    clearance: float
    gripper_clearance: float
    joints: Float[np.ndarray, "2 j"] | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Rollout(Shown, ArrayRecord):
    """What happened: row 0 is the start, row k the state after k control steps.

    In space points have 3 numbers, poses 7 and actions 6, see `Plan` and `cableway.geometry.groups.SE3`.

    Attributes:
        times: (K+1,) [s].
        keypoints: (K+1, n, 2) true keypoints [m].
        observed: (K+1, n, 2) what the controller saw [m], NaN where nothing.
        poses: (K+1, 2, 3) gripper poses [m, m, rad].
        centreline: (K+1, M, 2) the simulator's whole cable [m].
        actions: (K, 2, 3) gripper motion asked for in each step.
        reference: (K+1, n, 2) keypoints wanted at that time [m].
        solve_time: (K,) wall time of the controller in each step [s].
        status: (K,) short strings.
        clearance: (K+1,) least clearance of the cable's surface since the row before [m].
        gripper_clearance: (K+1,) the same for the gripper discs [m].
        metadata: Seed, versions, the resolved configuration, `outcome` and `detail`; where there are estimates,
            `metadata["estimates"]` says of each what it is: the fields of `Estimate` that stay the same, with its name.
        estimates: (K, m) the controller's estimates after each step; None where it has none.
        deviations: (K, m) standard deviations of that.
        joints: (K+1, 2, j) joint angles [rad] of the arms; None where there are none.
    """

    kind: ClassVar[str] = "rollout"

    times: Float[np.ndarray, "K+1"]
    keypoints: Float[np.ndarray, "K+1 n space"]
    observed: Float[np.ndarray, "K+1 n space"]
    poses: Float[np.ndarray, "K+1 2 pose"]
    centreline: Float[np.ndarray, "K+1 M space"]
    actions: Float[np.ndarray, "K 2 step"]
    reference: Float[np.ndarray, "K+1 n space"]
    solve_time: Float[np.ndarray, "K"]
    status: np.ndarray
    clearance: Float[np.ndarray, "K+1"]
    gripper_clearance: Float[np.ndarray, "K+1"]
    metadata: dict[str, Any] = field(default_factory=dict)
    estimates: Float[np.ndarray, "K m"] | None = None
    deviations: Float[np.ndarray, "K m"] | None = None
    joints: Float[np.ndarray, "K+1 2 j"] | None = None

    def __post_init__(self) -> None:
        check_shapes(self)
        _require(len(self.times) >= 1, "a rollout needs at least one row")
        _require_sizes(self.keypoints, self.poses, self.actions)
        _require(self.centreline.shape[1] >= 2, f"a centreline needs 2 points, got {self.centreline.shape[1]}")
        _require(len(self.status) == self.steps, f"status has {len(self.status)} rows, not {self.steps}")
        _require(self.status.dtype.kind not in "biufc", "status holds numbers, not short texts")
        _require_finite(
            self, "times", "keypoints", "poses", "centreline", "actions", "estimates", "deviations", "joints"
        )
        Outcome.read(self.metadata.get("outcome", Outcome.SETTLED))
        _require((self.estimates is None) == (self.deviations is None), "estimates and deviations go together")
        if self.estimates is not None:
            described, count = len(self.metadata.get("estimates", ())), self.estimates.shape[1]
            _require(described == count, f"the metadata describe {described} estimates, there are {count}")

    @property
    def steps(self) -> int:
        """K, the number of control steps."""
        return len(self.times) - 1

    def _facts(self) -> Iterator[str]:
        yield f"{self.outcome}: {self.detail}" if self.detail else str(self.outcome)
        yield f"{self.steps} steps in {self.times[-1] - self.times[0]:.1f} s"
        yield f"keypoints {self.keypoints.shape}"
        yield f"centreline {self.centreline.shape}"
        yield f"least clearance {quantity(self.least_clearance)}"

    @property
    def deviations_from_reference(self) -> Float[np.ndarray, "k"]:
        """(K+1,) largest distance of a keypoint from its reference in each row [m]."""
        return np.linalg.norm(self.keypoints - self.reference, axis=2).max(axis=1)

    @property
    def least_clearance(self) -> float:
        """Least clearance of cable and grippers [m]."""
        return float(min(self.clearance.min(), self.gripper_clearance.min()))

    @property
    def outcome(self) -> Outcome:
        """How the run ended; `SETTLED` where the metadata say nothing of it."""
        return Outcome.read(self.metadata.get("outcome", Outcome.SETTLED))[0]

    @property
    def detail(self) -> str:
        """What was particular to that end; "" where nothing was."""
        return self.metadata.get("detail") or Outcome.read(self.metadata.get("outcome", Outcome.SETTLED))[1]

    def animate(self, task: TaskSource, plan: Plan | None = None) -> Any:
        """The video of the run, which plays in a notebook and can be saved: a `cableway.figures.notebook.Animation`.

        Args:
            task: The task, or its name or file; a rollout does not know what stood on the table.
            plan: What was followed first, so that it can be shown where it was given up.

        Raises:
            InputError: There is no such task.
            CablewayError: The encoder failed.
        """
        return notebook().animation(self, task, plan)

    def shape_error(self, goal: Float[np.ndarray, "n 2"]) -> float:
        """Stacked distance of the last keypoints from a goal [m]."""
        return float(np.linalg.norm(self.keypoints[-1] - goal))

    def estimated(self) -> dict[str, Estimate]:
        """The controller's estimates at the end, by name."""
        if self.estimates is None or self.deviations is None or not self.steps:
            return {}
        rows = zip(self.metadata["estimates"], self.estimates[-1], self.deviations[-1], strict=True)
        return {
            row["name"]: Estimate(
                float(value), float(deviation), row.get("nominal", row.get("believed")), row["prior"], row["unit"]
            )
            for row, value, deviation in rows
        }


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise InputError(message)


def _require_sizes(points: np.ndarray, *others: np.ndarray) -> None:
    """Points, poses and actions are all of the plane, or all of space."""
    sizes = tuple(array.shape[2] for array in (points, *others))
    known = [each[: len(sizes)] for each in ((2, 3, 3), (3, 7, 6))]
    words = " and ".join(f"{name} of {size}" for name, size in zip(("poses", "actions"), sizes[1:], strict=False))
    _require(sizes in known, f"points of {sizes[0]} numbers do not go with {words}")


def _require_finite(record: Any, *names: str) -> None:
    for name in names:
        array = getattr(record, name)
        _require(array is None or bool(np.isfinite(array).all()), f"{name} holds a number that is not finite")
