"""A task: where a cable lies, where it shall lie, and what stands between."""

from __future__ import annotations

import copy
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Literal, Self

import numpy as np
from jaxtyping import Float

from cableway.core.brief import Shown
from cableway.core.errors import CablewayError, InputError, TaskError
from cableway.core.quantities import limit_text, size_text
from cableway.geometry import se2
from cableway.rod.inverse import fit_keypoints, stable_near
from cableway.rod.planar import PlanarRod
from cableway.scene import checks, validity
from cableway.scene.bodies import Body, body_pairs, outer_bodies
from cableway.scene.cable import Cable, EstimatedCable
from cableway.scene.cell import Cell, Way
from cableway.scene.grippers import Grippers, Plug, Port
from cableway.scene.scene import Scene
from cableway.scene.validity import SPLINE_PIECES as SPLINE_PIECES

CONTROL_STEP = 0.1
"""Time [s] of one control step, to which the gripper limits refer."""

RESUMED_CLEARANCE = 0.001
"""Clearance [m] that a start keeps from which a task is resumed."""

RESUMED_STABILITY = 8.0
"""Stability margin that it has; what is known of a cable at rest is not sure enough to plan from less."""

RESUMED_TENSION = 200.0
"""Force along the rod at its centre, in EI/L^2, that it has at most. Where the cable is pulled tauter, or shorter than
thought, small errors of the model are large motions of the grippers, and hardly a plan is accurate enough."""

MOVED_OFF = 0.02
"""Most that a keypoint is moved for that [m]; the cable is led there by the controller."""

LACK_WEIGHT = 100.0
"""Of a lack of clearance against as large a move of a keypoint."""

STABILITY_WEIGHT, TENSION_WEIGHT = 0.02, 0.001
"""Of a lack of stability, and of tension in excess [m]."""

End = Literal["start", "goal"]
ENDS: tuple[End, End] = ("start", "goal")

END_DECIMALS = 6
"""Decimals of ends that are computed, in metres and radians: tasks are the same on processors that round otherwise."""

PORT_ROOM = 0.001
"""By how much [m] each wall of a port is drawn beside an aligned plug."""

NAME = re.compile(r"\w[\w .+-]*")
"""A task's name; it becomes part of the names of folders."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Draft(Shown):
    """What a task says, whether or not a cable can do it; see `Task`.

    Attributes:
        name: For folders and reports: letters, digits, spaces and any of . _ + -
        description: One sentence.
        scene: Workspace and obstacles.
        cable: The cable.
        grippers: Footprint and limits.
        start: (n, 2) keypoints [m], left gripper first, at equal arc length; None where nothing but poses is known.
        goal: (n, 2) keypoints [m], or None.
        start_poses: (2, 3) gripper poses [m, m, rad] where the task states them; else the rod gives them.
        goal_poses: The same for the goal.
        plug: Optional plug at the cable's right end.
        port: Optional place the plug goes to; the goal is before it.
        cell: The arms that hold the grippers, whose body is the cell's tool; None where grippers move by themselves.

    Raises:
        TaskError: A value is of the wrong form, the port is without a plug, or in a cell the grippers have another
            body than its tool, or another tilt.
    """

    name: str
    scene: Scene
    cable: Cable
    start: Float[np.ndarray, "n 2"] | None
    goal: Float[np.ndarray, "n 2"] | None
    grippers: Grippers = field(default_factory=Grippers)
    start_poses: Float[np.ndarray, "2 3"] | None = None
    goal_poses: Float[np.ndarray, "2 3"] | None = None
    description: str = ""
    plug: Plug | None = None
    port: Port | None = None
    cell: Cell | None = None

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and NAME.fullmatch(self.name)):
            raise TaskError(
                f"must be letters, digits, spaces or any of . _ + -, got {checks.shown(self.name)}", ("name",)
            )
        if self.port is not None and self.plug is None:
            raise TaskError("needs a plug", ("port",))
        if self.cell is not None and self.grippers.body != self.cell.tool:
            raise TaskError(
                f"must be the cell's tool, {self.cell.tool}, got {self.grippers.body}", ("grippers", "body")
            )
        if self.cell is not None and self.grippers.tilt != self.cell.tilt:
            raise TaskError(f"must be the cell's, {self.cell.tilt:g}, got {self.grippers.tilt:g}", ("grippers", "tilt"))
        for end in ENDS:
            for name, columns in ((end, checks.XY), (f"{end}_poses", checks.POSE)):
                if getattr(self, name) is not None:
                    object.__setattr__(self, name, checks.rows(getattr(self, name), (name,), columns))
            poses = getattr(self, f"{end}_poses")
            if poses is not None and len(poses) != 2:
                raise TaskError(f"must be two poses (x, y, theta), got {len(poses)}", (f"{end}_poses",))

    @cached_property
    def bodies(self) -> tuple[Body, ...]:
        """What moves with the grippers: their discs and other pieces, and the plug where there is one."""
        pieces = self.grippers.bodies
        return pieces if self.plug is None else (*pieces, self.plug.body)

    @cached_property
    def outer_bodies(self) -> tuple[Body, ...]:
        """Those of `bodies` that obstacles or walls could touch first."""
        return outer_bodies(self.bodies, self.scene.heights)

    @cached_property
    def body_pairs(self) -> tuple[tuple[Body, Body], ...]:
        """Those of `bodies` that could touch each other first, the left gripper's before the right one's."""
        return body_pairs(self.bodies)

    @property
    def port_walls(self) -> Float[np.ndarray, "4 2"] | None:
        """Corners [m] of the walls of the port, from the left of its mouth; None where there is none. They stand for
        how wide and deep it is, and are no obstacles."""
        if self.port is None:
            return None
        width = self.plug.width if self.plug is not None else 2 * self.cable.radius
        half, depth = 0.5 * width + PORT_ROOM, self.port.depth
        local = np.array([[0.0, half], [depth, half], [depth, -half], [0.0, -half]])
        return se2.transform(local, np.array(self.port.position), self.port.angle)

    def gripper_poses(self, end: End) -> Float[np.ndarray, "2 3"]:
        """Gripper poses [m, m, rad] at start or goal: where stated, else as the keypoints have them."""
        poses = self.start_poses if end == "start" else self.goal_poses
        return validity.end_poses(getattr(self, end), self.cable) if poses is None else poses

    def plug_pose(self, end: End) -> Float[np.ndarray, "3"]:
        """Rear of the plug [m, m, rad] at start or goal."""
        return self.gripper_poses(end)[1]

    def unchecked(self) -> Draft:
        """The same, whether or not a cable can do it."""
        return Draft(**{entry.name: getattr(self, entry.name) for entry in fields(Draft)})

    def checked(self) -> Task:
        """The task, if a cable can do it.

        Raises:
            TaskError: It cannot.
        """
        return Task(**{entry.name: getattr(self, entry.name) for entry in fields(Draft)})

    def in_cell(self, cell: Cell) -> Self:
        """The same task with arms: grippers with the body of their tool, and heights where the scene states none.

        Raises:
            TaskError: The bodies leave start or goal of a `Task` no room.
        """
        grippers = replace(self.grippers, body=cell.tool, tilt=cell.tilt)
        return replace(self, scene=cell.furnished(self.scene), grippers=grippers, cell=cell)

    def faults(self) -> Iterator[TaskError]:
        """Why no cable can do it."""
        for end in ENDS:
            shape, poses = getattr(self, end), getattr(self, f"{end}_poses")
            faults: list[TaskError] = []
            if shape is not None:
                faults = list(validity.shape_faults(end, shape, self.scene, self.cable, self.grippers))
                yield from faults
                if poses is not None and not faults:
                    yield from validity.pose_faults(end, poses, shape, self.cable)
            if self.ends_somewhere(end):
                yield from validity.body_faults(end, self.gripper_poses(end), self.bodies, self.scene)
                if shape is not None and len(shape) == self.cable.keypoints and not faults:
                    at = self.gripper_poses(end)
                    yield from validity.body_on_cable_faults(end, shape, at, self.bodies, self.cable)
        if self.port is not None and self.plug is not None and self.ends_somewhere("goal"):
            yield from validity.port_faults(self.plug_pose("goal"), self.plug, self.port)

    def ends_somewhere(self, end: End) -> bool:
        """Whether `gripper_poses` are known."""
        shape = getattr(self, end)
        return getattr(self, f"{end}_poses") is not None or (shape is not None and len(shape) == self.cable.keypoints)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Task(Draft):
    """A start shape, a goal shape, the cable and the scene.

    Raises:
        TaskError: A shape has the wrong number of keypoints or length, lies outside the workspace, touches an
            obstacle, crosses itself or bends too sharply, stated gripper poses are not at its ends, the plug has no
            room, or the goal is not before the port. It has the draft and all its faults.
    """

    start: Float[np.ndarray, "n 2"]
    goal: Float[np.ndarray, "n 2"]

    def __post_init__(self) -> None:
        super().__post_init__()
        faults = list(self.faults())
        if faults:
            raise faults[0].of(self, faults[1:])

    def _facts(self) -> Iterator[str]:
        obstacles = len(self.scene.obstacles)
        yield repr(self.name)
        yield f"cable {limit_text(self.cable.length)}"
        yield f"{obstacles} obstacle{'s'[: obstacles != 1]} in {size_text(self.scene.size)}"

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the task to a YAML file; see `save_task`."""
        from cableway.scene.files.saving import save_task  # which reads and writes this class

        save_task(self, path)

    def in_scene(self, scene: Scene) -> Task:
        """The same task in another scene, whatever start and goal now touch: for a run that is under way."""
        moved = copy.copy(self)
        object.__setattr__(moved, "scene", scene)
        moved.__dict__.pop("outer_bodies", None)  # which depend on the heights of its obstacles
        return moved

    def as_recorded(self, metadata: Mapping[str, Any]) -> Task:
        """The same task with obstacles and pegs where the metadata of a rollout have them, known or not.

        Raises:
            InputError: They do not fit the task.
        """
        plant = metadata.get("plant")
        given = plant if isinstance(plant, dict) else {}
        try:
            by, discs = ([tuple(map(float, row)) for row in given.get(name) or ()] for name in ("obstacles", "pegs"))
            changed = self.scene.changed(by, discs)  # pyright: ignore[reportArgumentType]
        except (TypeError, ValueError, CablewayError) as error:
            raise InputError(f"the rollout's plant.obstacles and plant.pegs do not fit the task: {error}") from error
        return self.in_scene(changed) if by or discs else self

    def held(self, way: Way) -> Task:
        """The same task in its cell, whose arms hold the cable already; for a run that is under way."""
        taken = copy.copy(self)
        object.__setattr__(taken, "cell", self.cell and replace(self.cell, way=way))
        return taken

    def at_speed(self, share: float) -> Task:
        """The same task with a share of the grippers' limits, for first trials on a robot.

        Args:
            share: Of `Grippers.max_step` and `Grippers.max_turn`, above 0 and at most 1.

        Raises:
            InputError: It is not.
        """
        if not 0 < share <= 1:
            raise InputError(f"speed must be above 0 and at most 1, got {share!r}")
        limits = self.grippers
        slow = replace(limits, max_step=share * limits.max_step, max_turn=share * limits.max_turn)
        return self if share == 1 else replace(self, grippers=slow)

    def resumed_from(self, keypoints: Float[np.ndarray, "n 2"], cable: EstimatedCable | None = None) -> Task:
        """The same task from where the cable is now.

        The start is the equilibrium nearest to the keypoints, which takes away most of what a camera adds. Where the
        cable or a gripper would touch something or snap there, or nearly, or be pulled taut, it is moved off by as
        little as possible, or else it is the stable one between the same grippers.

        Args:
            keypoints: (n, 2) [m] as measured.
            cable: As it turned out to be; the goal is then what comes nearest to the task's. None for the task's own.

        Raises:
            TaskError: They are not finite, of another number than the task's, or deep in collision.
        """
        points = checks.rows(keypoints, ("start",), checks.XY)
        if points.shape != self.start.shape:
            raise TaskError(f"must have shape {self.start.shape}, got {points.shape}", ("start",))
        if cable is None:
            return replace(self, start=self._resting(points, self.cable.rod), start_poses=None)
        start, goal = (self._resting(shape, cable.rod) for shape in (points, self.goal))
        return replace(self, cable=cable, start=start, goal=goal, start_poses=None, goal_poses=None)

    def _resting(self, keypoints: Float[np.ndarray, "n 2"], rod: PlanarRod) -> Float[np.ndarray, "n 2"]:
        """The stable free shape of a rod nearest to keypoints [m], see `resumed_from`."""
        q = self._moved_off(fit_keypoints(rod, keypoints)[0], rod)
        if rod.stability(q[None])[0][0] <= 0:
            q = self._moved_off(stable_near(rod, q), rod)
        return rod.at_keypoints(rod.shapes(q[None])[0])[0]

    def _moved_off(self, q: Float[np.ndarray, "dof"], rod: PlanarRod) -> Float[np.ndarray, "dof"]:
        """The equilibrium nearest to q with `RESUMED_CLEARANCE`, `RESUMED_STABILITY` and `RESUMED_TENSION`, or q where
        it is far from q.

        Note:
            Once in a recovery, so by SciPy. Not by `cableway.motion`, which comes after tasks: a start is where the
            cable is, and may keep less than a plan.
        """
        from cableway.scene.clearance import bodies_gap, body_clearance, cable_gap  # which read this class

        keypoints = rod.at_keypoints(rod.shapes(q[None])[0])[0]
        solid = [body for body in self.outer_bodies if len(body.outline) > 1]

        def lack(x: np.ndarray) -> np.ndarray:
            (stations,), poses = rod.shapes(x[None])
            less = STABILITY_WEIGHT * (RESUMED_STABILITY - rod.stability(x[None], RESUMED_STABILITY)[0])
            taut = TENSION_WEIGHT * max(0.0, x[rod.loads.start] - RESUMED_TENSION)
            wanted = np.full(len(stations), self.cable.radius + RESUMED_CLEARANCE)
            wanted[[0, -1]] += max(0.0, self.grippers.radius - self.cable.radius)
            short = LACK_WEIGHT * np.maximum(0.0, wanted - self.scene.signed_distance(stations))
            if not solid:
                return np.array([*short, *less, taut])
            apart, off = bodies_gap(self.body_pairs, poses), cable_gap(self.bodies, stations[None], poses, self.cable)
            room = np.concatenate([*(body_clearance(body, poses, self.scene) for body in solid), apart, off])
            near = LACK_WEIGHT * np.maximum(0.0, RESUMED_CLEARANCE - room)
            return np.array([*short, *less, taut, *near])

        def residuals(x: np.ndarray) -> np.ndarray:
            stations = rod.shapes(x[None])[0]
            moved = rod.at_keypoints(stations)[0] - keypoints
            return np.concatenate([moved.ravel(), lack(x)])

        if not lack(q).any():
            return q
        from scipy.optimize import least_squares  # here, since most tasks are read without it

        found = least_squares(residuals, q, x_scale=rod.units).x
        moved = rod.at_keypoints(rod.shapes(found[None])[0])[0] - keypoints
        return found if np.linalg.norm(moved, axis=1).max() <= MOVED_OFF else q

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Task):
            return NotImplemented
        pairs = ((getattr(self, entry.name), getattr(other, entry.name)) for entry in fields(self))
        return all(np.array_equal(a, b) if isinstance(a, np.ndarray) else a is b or a == b for a, b in pairs)

    __hash__ = None  # pyright: ignore[reportAssignmentType]

    @property
    def start_equilibrium(self) -> Float[np.ndarray, "dof"]:
        """Rod coordinates of the equilibrium nearest to the start."""
        return self._nearest_equilibria[0][0]

    @property
    def goal_equilibrium(self) -> Float[np.ndarray, "dof"]:
        """Rod coordinates of the equilibrium nearest to the goal."""
        return self._nearest_equilibria[1][0]

    @property
    def equilibrium_distances(self) -> tuple[float, float]:
        """Stacked distances [m] of start and goal from the equilibria nearest to them."""
        (_, start), (_, goal) = self._nearest_equilibria
        return start, goal

    @cached_property
    def _nearest_equilibria(self) -> tuple[tuple[Float[np.ndarray, "dof"], float], ...]:
        return fit_keypoints(self.cable.rod, self.start), fit_keypoints(self.cable.rod, self.goal)
