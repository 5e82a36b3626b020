"""Named solids, lines and letters of one page, drawn anew only where they changed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import viser
from jaxtyping import Float

from cableway.core.errors import Point
from cableway.geometry import se2
from cableway.studio.view.look import lit, painted, rgb
from cableway.studio.view.meshes import Mesh

OnDrag = Callable[[str, str, Point], Any]
"""Called with the name of what is dragged, the phase ("start", "update", "end"), and the place on the table [m]."""

OnClick = Callable[[str], Any]
"""Called with the name of what is clicked."""

OnPose = Callable[[str, str, Float[np.ndarray, "7"]], Any]
"""Called with the name of a gizmo, the phase as in a drag, and its frame [m, 1]."""


class Canvas:
    """What one page shows.

    Args:
        client: The page's connection.
        on_drag: Told of drags.
        on_click: Told of clicks.
        on_pose: Told of frames that are moved and turned.
    """

    def __init__(self, client: viser.ClientHandle, on_drag: OnDrag, on_click: OnClick, on_pose: OnPose) -> None:
        self._scene, self._on_drag, self._on_click, self._on_pose = client.scene, on_drag, on_click, on_pose
        self._nodes: dict[str, tuple[Any, Any]] = {}
        self._drawn: set[str] = set()
        self._grabbed = 0.0

    def solid(
        self,
        name: str,
        mesh: Mesh,
        color: str,
        *,
        at: Sequence[float] = (0.0, 0.0),
        angle: float = 0.0,
        turn: Sequence[float] | None = None,
        opacity: float | None = None,
        draggable: bool = False,
        clickable: bool = False,
    ) -> None:
        """A solid, at a place [m] on the table or in space, turned about the vertical [rad] or by a quaternion."""
        self._drawn.add(name)
        kind = ("solid", mesh.faces.shape, opacity)
        handle, known = self._nodes.get(name, (None, None))
        if known != kind:
            handle = self._scene.add_mesh_simple(
                name, mesh.vertices, mesh.faces, color=painted(color), opacity=opacity,
                side="double" if opacity is None else "front",
                cast_shadow=False, receive_shadow=False,
            )  # fmt: skip
            self._nodes[name] = handle, kind
            # a page keeps the pose of a node of that name taken away in the same picture, and is told of none that is
            # as usual
            handle.position, handle.wxyz = (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0, 0.0)
            if draggable:
                handle.on_drag("left")(self._dragged(name))
            if clickable:
                handle.on_click(self._clicked(name))
        elif not np.array_equal(handle.vertices, mesh.vertices.astype(np.float32)):
            handle.vertices = mesh.vertices.astype(np.float32)
        _set(handle, "color", painted(color))
        _set(handle, "position", (*at, 0.0)[:3])
        _set(handle, "wxyz", (np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)) if turn is None else tuple(turn))

    def lines(
        self,
        name: str,
        points: Float[np.ndarray, "k 2 3"],
        color: str | Sequence[str],
        width: float,
    ) -> None:
        """Segments [m], as wide as so many pixels, of one colour or each of its own.

        What belongs together is better one node than several: without graphics hardware, each takes the page a
        millisecond or more of every picture.
        """
        self._drawn.add(name)
        handle, known = self._nodes.get(name, (None, None))
        kind = ("lines", points.shape, color, width)
        if known != kind:
            one = isinstance(color, str)
            colors = rgb(color) if one else np.repeat([[lit(each)] for each in color], 2, axis=1)
            handle = self._scene.add_line_segments(name, points, colors, thickness=width, thickness_units="screen")
            self._nodes[name] = handle, kind
        elif not np.array_equal(handle.points, points.astype(np.float32)):
            handle.points = points.astype(np.float32)

    def words(self, name: str, text: str, at: tuple[float, float, float], anchor: Any = "center-center") -> None:
        """Letters at a place [m], of the same size however near it is."""
        self._drawn.add(name)
        handle, known = self._nodes.get(name, (None, None))
        if known != ("words", anchor):
            handle = self._scene.add_label(name, text, position=at, anchor=anchor, font_screen_scale=0.85)
            self._nodes[name] = handle, ("words", anchor)
        _set(handle, "text", text)
        _set(handle, "position", at)

    def gizmo(
        self,
        name: str,
        frame: Float[np.ndarray, "7"],
        scale: float,
        *,
        axes: tuple[bool, bool, bool] = (True, True, True),
        turns: bool = True,
        held: bool = False,
    ) -> None:
        """Arrows and arcs by which a frame [m, 1] is moved and turned; they stay where the hand has them while held."""
        self._drawn.add(name)
        handle, known = self._nodes.get(name, (None, None))
        kind = ("gizmo", scale, axes, turns)
        if known != kind:
            handle = self._scene.add_transform_controls(
                name, scale, line_width=3.0, active_axes=axes, disable_rotations=not turns, disable_sliders=True,
                depth_test=False, opacity=0.9, position=frame[:3], wxyz=frame[3:],
            )  # fmt: skip
            self._nodes[name] = handle, kind
            handle.on_update(self._posed(name))
        elif not held:
            _set(handle, "position", tuple(frame[:3]))
            _set(handle, "wxyz", tuple(frame[3:]))

    def clear(self) -> None:
        """Take all away."""
        self._drawn.clear()
        self.sweep("/")

    def sweep(self, prefix: str) -> None:
        """Take away what begins so and was not drawn since the last sweep of it."""
        for name in [name for name in self._nodes if name.startswith(prefix) and name not in self._drawn]:
            self._nodes.pop(name)[0].remove()
        self._drawn = {name for name in self._drawn if not name.startswith(prefix)}

    def _dragged(self, name: str) -> Callable[[Any], Any]:
        async def on_drag(event: viser.SceneNodeDragEvent[Any]) -> None:
            if event.phase == "start":
                self._grabbed = event.start_position[2]
            eye, to = event.client.camera.position, np.array(event.end_position)
            ray = to - eye
            if abs(ray[2]) > 1e-9:
                to = eye + (self._grabbed - eye[2]) / ray[2] * ray
            self._on_drag(name, event.phase, (float(to[0]), float(to[1])))

        return on_drag

    def _posed(self, name: str) -> Callable[[Any], Any]:
        async def on_update(event: viser.TransformControlsEvent) -> None:
            frame = np.concatenate([event.target.position, event.target.wxyz])
            self._on_pose(name, event.phase, frame)

        return on_update

    def _clicked(self, name: str) -> Callable[[Any], Any]:
        async def on_click(_: Any) -> None:
            self._on_click(name)

        return on_click


def outline(points: Float[np.ndarray, "k 2"], height: float) -> Float[np.ndarray, "k 2 3"]:
    """The sides of a closed line [m] as segments at a height."""
    corners = np.column_stack([points, np.full(len(points), height)])
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def path(points: Float[np.ndarray, "k 2"], height: float) -> Float[np.ndarray, "j 2 3"]:
    """An open line [m] as segments at a height."""
    corners = np.column_stack([points, np.full(len(points), height)])
    return np.stack([corners[:-1], corners[1:]], axis=1)


def along(pose: Float[np.ndarray, "3"], by: float) -> Point:
    """The place so far [m] ahead of a gripper pose."""
    x, y = se2.transform(np.array([[by, 0.0]]), pose[:2], float(pose[2]))[0]
    return float(x), float(y)


def _set(handle: Any, name: str, value: Any) -> None:
    """Change what is shown, if it changes."""
    if not np.array_equal(getattr(handle, name), value):
        setattr(handle, name, value)
