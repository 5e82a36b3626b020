"""A table plant whose arms get hold of the cable where it lies, and let it go again.

Until the hands have closed, and once they open, a clip without a body holds each end of the cable where it is, since a
bent elastic cable that nothing holds springs straight; with `GraspConfig.clips` off it does. Hands come down as the
joints say that they are given, close, and hold what is between their pads: a cable's end that is no farther from the
middle of a pad than half its length, along the cable, no nearer to a finger than its radius, no higher or lower than
`LEVEL`, and turned by no more than `MOST_TURN`. They hold it as it lies there; nothing centres it. Open fingers do not
collide; their clearance is measured, as if they were down all the time.
"""

# MuJoCo's bindings are compiled and carry no type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import mujoco
import numpy as np
from jaxtyping import Float

from cableway.core.errors import GraspError, SimulationError
from cableway.core.quantities import quantity
from cableway.geometry.groups import SE2
from cableway.records import Observation
from cableway.robot.grasping import CLOSING, hands_clearance
from cableway.scene.gripper_bodies import open_hand
from cableway.scene.grippers import SIDES
from cableway.scene.task import CONTROL_STEP
from cableway.simulation.arms import ArmDrive
from cableway.simulation.drives import NAMES
from cableway.simulation.perturbations.grasp import MOST_TURN
from cableway.simulation.surroundings import close_clip
from cableway.simulation.table_plant import EVERY, LONGEST_SETTLING, REST, TablePlant

LEVEL = 0.004
"""Height [m] by which a hand may be off the cable's axis and still hold it: the radius of a usual cable."""


class HandlingPlant(TablePlant):
    """A table plant with arms, which hold the cable at its start unless `take_hold` is called first."""

    can_grasp = True
    """Whether `take_hold` and `let_go` may be called."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._laid = self.grasp

    def reset(self) -> Observation:
        """See `TablePlant.reset`."""
        self.grasp = self._laid
        return super().reset()

    @property
    def _arms(self) -> ArmDrive:
        return cast(ArmDrive, self._drive)

    def take_hold(self, joints: Float[np.ndarray, "t 2 6"], opening: float) -> Observation:
        """At the start: lay the cable free, lower the hands to it from above, and close them.

        Args:
            joints: Positions [rad], a control step from row to row, the last one where the cable is held.
            opening: Distance [m] of the fingers until they close.

        Returns:
            What is observed then; the time is still 0, and what was touched is in the next measurement.

        Raises:
            GraspError: The end of the cable is not between the fingers of a hand.
            SimulationError: The simulation diverged, or it is too late.
        """
        if self._steps:
            raise SimulationError("the arms hold the cable already")
        self._arms.put(self._data, joints[0])
        self._release()
        if not self.grasp.clips:
            self._settle(joints[0], opening)
        moved = [self._moved(row, opening) for row in (*joints[1:], *self._standing(joints[-1], CLOSING / 2))]
        self._require_between(opening)
        self._arms.grip(self._data, True)
        self._clips(False)
        moved += [self._lead(self._commanded) for _ in self._standing(joints[-1], CLOSING / 2)]
        self._clearances = (min(cable for cable, _ in moved), min(hands for _, hands in moved))
        return self._observe()

    def let_go(self, joints: Float[np.ndarray, "t 2 6"], opening: float) -> float:
        """Open the hands and raise them; how far a point of the cable has moved by then [m].

        Args:
            joints: Positions [rad], a control step from row to row, the first one where the cable is held.
            opening: Distance [m] of the fingers from then on.

        Raises:
            SimulationError: The simulation diverged.
        """
        before = self._line()
        self._release()
        rows = (*self._standing(joints[0], CLOSING), *joints[1:], *self._standing(joints[-1], CLOSING / 2))
        moved = [self._moved(row, opening) for row in rows]
        self._clearances = (min(cable for cable, _ in moved), min(hands for _, hands in moved))
        return float(np.linalg.norm(self._line() - before, axis=1).max())

    def _release(self) -> None:
        """Let clips hold the cable in place of hands, or nothing."""
        self._clips(self.grasp.clips)
        self._arms.grip(self._data, False)

    def _clips(self, closed: bool) -> None:
        for name in NAMES:
            if closed:
                close_clip(self.model, self._data, f"{name} clip")
            else:
                self._data.eq_active[self.model.equality(f"{name} clip").id] = False

    def _standing(self, joints: Float[np.ndarray, "2 6"], time: float) -> list[Float[np.ndarray, "2 6"]]:
        """Rows of arms that stand for a time [s]."""
        return [joints] * round(time / CONTROL_STEP)

    def _settle(self, joints: Float[np.ndarray, "2 6"], opening: float) -> None:
        """Let the cable come to rest below the hands."""
        for _ in range(round(LONGEST_SETTLING / CONTROL_STEP)):
            before = self._line()
            self._moved(joints, opening)
            if np.abs(self._line() - before).max() < REST * CONTROL_STEP:
                return

    def _moved(self, joints: Float[np.ndarray, "2 6"], opening: float) -> tuple[float, float]:
        """Lead joints evenly to positions [rad] in one control step; the least clearances of cable and open hands."""
        data, count, begin = self._data, self.config.substeps, self._arms.state()[:, :6]
        lines, poses, measured = [], [], []
        data.warning.number[:] = 0
        for substep in range(1, count + 1):
            self._arms.follow(data, begin + substep / count * (joints - begin))
            mujoco.mj_step(self.model, data)
            if substep % EVERY == 0:
                lines.append(self._line())
                poses.append(self._reached)
                measured.append(self._arms.joints())
        if data.warning.number.any() or not np.isfinite(data.qpos).all():
            raise SimulationError("the simulation diverged while the hands moved")
        scene, at = self.task.in_scene(self._scene), np.array(poses)
        hands, apart = hands_clearance(at, np.array(lines), opening, scene)
        cable = float(self._scene.clearance(np.array(lines), self.cable.radius).min())
        return cable, min(float(hands.min()), float(apart.min()), self._arms.clearance(np.array(measured)))

    def _require_between(self, opening: float) -> None:
        """Raise a GraspError where the end of the cable is not between the fingers of a hand; note how it is held."""
        assert self.task.cell is not None
        pad = float(open_hand(self.task.cell.tool, opening)[0].outline[:, 0].max())
        line, hands, last = self._line(), self._reached, self.config.segments
        angles = np.arctan2(*(line[[1, -1]] - line[[0, -2]]).T[::-1])
        ends = SE2.compose(SE2.inverse(hands), np.column_stack([line[[0, -1]], angles]))
        ends = SE2.continued(ends, np.zeros_like(ends))
        heights = self._data.xpos[[1, last], 2] - [self._data.body(f"{name} gripper").xpos[2] for name in NAMES]
        most = np.array([pad, opening / 2 - self.cable.radius, MOST_TURN, LEVEL])
        for (name, _), found in zip(SIDES, np.column_stack([ends, heights]), strict=True):
            if (np.abs(found) > most).any():
                ahead, aside, turn, above = (
                    quantity(float(value), unit) for value, unit in zip(found, ("m", "m", "rad", "m"), strict=True)
                )
                raise GraspError(
                    f"the {name} missed the cable, whose end is {ahead} ahead of the middle of its fingers, {aside} to "
                    f"the left, turned by {turn} and {above} above"
                )
        if not self.grasp.clips:
            left, right = ((float(x), float(y), float(turn)) for x, y, turn in ends)
            self.grasp = replace(self.grasp, left=left, right=right)
