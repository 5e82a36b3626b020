"""What is dragged on a page: from when it is taken hold of until it is let go."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float

from cableway.core.errors import CablewayError, Point
from cableway.studio.obstacles import with_obstacle
from cableway.studio.session import Moment, Session
from cableway.studio.view.hands import SpaceHands, TableHands


class Shown(Protocol):
    """What a page does about drags."""

    @property
    def hands(self) -> TableHands | SpaceHands:
        """What they do to the session."""
        ...

    def clicked(self, name: str) -> None:
        """Something was taken hold of by its name, which selects it."""

    def show(self) -> None:
        """Show the session as it is."""

    def snapped(self, name: str) -> None:
        """A cable jumped to another shape while something was dragged."""

    def let_go(self) -> None:
        """What was dragged is where it stays."""


class Drags:
    """The drags on a page, one after the other.

    Args:
        session: What they change.
        do: Does something when it is its turn, instead of what waits under the same key.
        shown: The page.

    Attributes:
        held: Where the drag under way began; None where there is none.
        pushed: Which obstacle of a run is being pushed, and where it is by now.
        released: When something was let go last, of `time.monotonic`.
    """

    def __init__(self, session: Session, do: Callable[..., None], shown: Shown) -> None:
        self._session, self._do, self._shown = session, do, shown
        self.held: Moment | None = None
        self.pushed: tuple[int, Any] | None = None
        self.released = 0.0
        self._grabs, self._offset = 0, np.zeros(2)

    def close(self) -> None:
        """The page is gone: what it holds is let go."""
        if self.held is not None:
            self._session.release(self.held)

    def dragged(self, name: str, phase: str, to: Point) -> None:
        """A pointer on the table or on a level drags what has this name."""
        if phase == "start":
            self._grabs += 1
            self._do(lambda: self._grab(name, to))
        self._do(lambda: self._drag(name, to), key=f"drag {self._grabs}")
        if phase == "end":
            self._do(self._let_go)

    def posed(self, name: str, phase: str, frame: Float[np.ndarray, "7"]) -> None:
        """A gizmo is taken to a frame."""
        if phase == "start":
            self._grabs += 1
            self._do(self._take)
        self._do(lambda: self._pose(name, frame), key=f"drag {self._grabs}")
        if phase == "end":
            self._do(self._let_go)

    def _grab(self, name: str, to: Point) -> None:
        running, hands = self._session.running, self._shown.hands
        if name.startswith("/obstacles/") and running is not None and running.live:
            index = int(name.split("/")[2])
            self.pushed = index, running.scene.obstacles[index]
            self._offset = hands.middle_of(running.scene.obstacles[index]) - np.array(to)
            return
        self._take()
        place = hands.place_of(name)
        if isinstance(hands, SpaceHands) or name.startswith("/obstacles/"):
            self._shown.clicked(name)
        self._offset = place - np.array(to)

    def _take(self) -> None:
        self.held = self._session.hold()

    def _drag(self, name: str, pointer: Point) -> None:
        to, hands = np.array(pointer) + self._offset, self._shown.hands
        if self.pushed is not None:
            self.pushed = self.pushed[0], hands.moved(self.pushed[1], (float(to[0]), float(to[1])))
            self._shown.show()
        elif self.held is not None:
            held = self.held
            self._lead(name, lambda: hands.drag(name, held, to))

    def _pose(self, name: str, frame: Float[np.ndarray, "7"]) -> None:
        held, hands = self.held, self._shown.hands
        if held is not None and isinstance(hands, SpaceHands):
            self._lead(name, lambda: hands.pose(name, held, frame))

    def _lead(self, name: str, drag: Callable[[], bool]) -> None:
        try:
            snapped = drag()
        except CablewayError:
            return  # a hand may go where nothing can be; it stays at the last place where it can
        if snapped:
            self._shown.snapped(name)

    def _let_go(self) -> None:
        pushed, self.pushed = self.pushed, None
        if pushed is not None:
            self._push(*pushed)
            return
        held, self.held = self.held, None
        if held is not None:
            self.released = time.monotonic()
            self._session.release(held)
            self._shown.let_go()

    def _push(self, index: int, pushed: Any) -> None:
        """Push an obstacle of a run by as far as it was dragged."""
        hands, draft = self._shown.hands, self._session.draft
        obstacle = with_obstacle(draft, index, pushed).scene.obstacles[index]
        x, y = hands.middle_of(obstacle) - hands.middle_of(draft.scene.obstacles[index])
        try:
            self._session.push(index, (float(x), float(y)))
        finally:
            self._shown.show()
