"""What hands do to a session: by the name of what is dragged on a page, on the table and in space."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.core.errors import Point
from cableway.scene.task import End
from cableway.studio import obstacles, spatial_obstacles
from cableway.studio.session import Moment, Session
from cableway.studio.view import table


def parts(name: str) -> tuple[str, str, list[str]]:
    """What is dragged, which one, and what of it: ("ends", "start", ["0", "turn"])."""
    what, which, *more = re.split("[/-]", name)[1:]
    return what, which, more


def gripper(which: str, more: list[str]) -> tuple[End, int]:
    """Which gripper that is."""
    return ("start" if which == "start" else "goal"), int(more[0])


class TableHands:
    """On the table.

    Args:
        session: What they change.
        selected: Which obstacle is selected.
    """

    def __init__(self, session: Session, selected: Callable[[], int | None]) -> None:
        self._session, self._selected = session, selected

    def place_of(self, name: str) -> Any:
        """Where what is dragged is [m]."""
        what, which, more = parts(name)
        draft, shapes = self._session.moment
        if what == "ends":
            end, side = gripper(which, more)
            q = shapes[end]
            assert q is not None
            pose = draft.cable.rod.end_poses(q[None])[0, side]
            return np.array(table.along(pose, table.ARM if side else -table.ARM)) if len(more) > 1 else pose[:2]
        if what == "obstacles":
            return self.middle_of(draft.scene.obstacles[int(which)])
        selected = self._selected()
        assert selected is not None
        obstacle: Any = draft.scene.obstacles[selected]
        return table.turn_knob(obstacle) if which == "turn" else obstacles.knobs(obstacle)[int(which)]

    def middle_of(self, obstacle: Any) -> Float[np.ndarray, "2"]:
        """Where an obstacle is seen from above [m]."""
        return obstacles.middle_of(obstacle)

    def moved(self, obstacle: Any, to: Point) -> Any:
        """An obstacle with its middle there, seen from above [m]."""
        return obstacles.placed(obstacle, to)

    def drag(self, name: str, held: Moment, to: Float[np.ndarray, "2"]) -> bool:
        """Show what is dragged there [m]; returns whether the cable snapped.

        Raises:
            InputError: It cannot be so.
        """
        what, which, more = parts(name)
        selected, place = self._selected(), (float(to[0]), float(to[1]))
        if what == "ends":
            return self._drag_gripper(*gripper(which, more), to, turning=len(more) > 1)
        if what == "obstacles":
            there = held.draft.scene.obstacles[int(which)]
            self._session.preview_obstacle(held, int(which), self.moved(there, place))
        elif selected is not None:
            obstacle: Any = held.draft.scene.obstacles[selected]
            if which == "turn":
                middle = obstacles.middle_of(obstacle)
                before, now = table.turn_knob(obstacle) - middle, to - middle
                by = np.arctan2(now[1], now[0]) - np.arctan2(before[1], before[0])
                wanted = obstacles.turned(obstacle, float(by))
            else:
                wanted = obstacles.pulled(obstacle, int(which), place)
            self._session.preview_obstacle(held, selected, wanted)
        return False

    def _drag_gripper(self, end: End, side: int, to: Any, *, turning: bool) -> bool:
        draft, shapes = self._session.moment
        q = shapes[end]
        if q is None:
            return False
        pose = draft.cable.rod.end_poses(q[None])[0, side].copy()
        if turning:
            x, y = (to - pose[:2]) * (1 if side else -1)
            turn = np.arctan2(y, x) - pose[2]
            pose[2] += (turn + np.pi) % (2 * np.pi) - np.pi
        else:
            pose[:2] = np.clip(to, 0.0, draft.scene.size)
        return self._session.preview_gripper(end, side, pose)


class SpaceHands:
    """In space: what is dragged by itself keeps its height, and by a gizmo goes anywhere."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def place_of(self, name: str) -> Any:
        """Where what is dragged is, seen from above [m]."""
        what, which, more = parts(name)
        return self._pose(*gripper(which, more))[:2] if what == "ends" else self.middle_of(self._obstacle(int(which)))

    def middle_of(self, obstacle: Any) -> Float[np.ndarray, "2"]:
        """Where an obstacle is seen from above [m]."""
        return spatial_obstacles.frame_of(obstacle)[:2]

    def moved(self, obstacle: Any, to: Point) -> Any:
        """An obstacle with its middle there, seen from above [m]."""
        frame = spatial_obstacles.frame_of(obstacle)
        return spatial_obstacles.placed(obstacle, np.array([*to, *frame[2:]]))

    def drag(self, name: str, held: Moment, to: Float[np.ndarray, "2"]) -> bool:
        """Show what is dragged there, seen from above [m]; returns whether the cable snapped.

        Raises:
            InputError: It cannot be so.
        """
        what, which, more = parts(name)
        if what == "ends":
            end, side = gripper(which, more)
            return self._lead(end, side, np.array([*to, *self._pose(end, side)[2:]]))
        there = held.draft.scene.obstacles[int(which)]
        self._session.preview_obstacle(held, int(which), self.moved(there, (float(to[0]), float(to[1]))))
        return False

    def pose(self, name: str, held: Moment, frame: Float[np.ndarray, "7"]) -> bool:
        """The same of what a gizmo, whose name goes on behind "/gizmo", takes to a frame [m, 1]."""
        what, which, more = parts(name.removeprefix("/gizmo"))
        if what == "ends":
            return self._lead(*gripper(which, more), frame)
        there: Any = held.draft.scene.obstacles[int(which)]
        self._session.preview_obstacle(held, int(which), spatial_obstacles.placed(there, frame))
        return False

    def _lead(self, end: End, side: int, pose: Float[np.ndarray, "7"]) -> bool:
        within = np.clip(pose[:3], 0.0, self._session.draft.scene.size)
        return self._session.preview_gripper(end, side, np.concatenate([within, pose[3:]]))

    def _pose(self, end: End, side: int) -> Float[np.ndarray, "7"]:
        q = self._session.moment.shapes[end]
        assert q is not None
        return self._session.draft.cable.rod.end_poses(q[None])[0, side]

    def _obstacle(self, index: int) -> Any:
        return self._session.draft.scene.obstacles[index]
