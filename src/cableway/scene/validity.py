"""Whether a start or goal shape is one that the cable can have in its scene."""

from __future__ import annotations

import numpy as np
import shapely
from jaxtyping import Float

from cableway.core.errors import TaskError
from cableway.geometry import polyline, se2
from cableway.geometry.groups import SE2
from cableway.rod.inverse import fit_keypoints
from cableway.scene.cable import Cable, EstimatedCable
from cableway.scene.grippers import Grippers, Plug, Port
from cableway.scene.scene import Scene

LENGTH_TOLERANCE = 0.02
"""Relative error of length above which a start or goal shape is refused."""

SPACING_TOLERANCE = 0.2
"""Relative error of the arc length between two keypoints above which a shape is refused: keypoints measured to 1 mm
vary by 6% on the catalogue's 25 mm, those placed without regard to arc length by far more."""

SPLINE_PIECES = 6
"""Vertices between two keypoints where the cable is drawn through them: 4 mm apart on 0.3 m."""

SPLINE_KEYPOINTS = 10
"""Least number of keypoints at which a spline through them keeps the length of any stable rod to 2% (measured on
4000 random equilibria: 1.2% at 10, 2.1% at 7, 14% at 5)."""

ROD_TOLERANCE = 0.01
"""Stacked distance, in lengths of the cable, up to which keypoints count as those of the nearest equilibrium."""

POSE_TOLERANCE = (1e-3, 0.35)
"""How far [m] a stated gripper pose may be from the shape's end, and how far [rad] from its direction there."""


PLUG_SPACING = 0.002
"""Distance [m] of the points round a plug at which the depth of an overlap is measured."""

PORT_TOLERANCE = 5e-3
"""How far [m] the right end of the goal may be from where the plug is before the port."""


def check_shape(end: str, shape: Float[np.ndarray, "n 2"], scene: Scene, cable: Cable, grippers: Grippers) -> None:
    """Refuse keypoints [m] that the cable cannot have in the scene; `end` ("start" or "goal") names them.

    Raises:
        TaskError: Wrong number of keypoints, outside the workspace, wrong length, not at equal arc length, crossing
            itself, bent too sharply, overlapping an obstacle or wall, or grippers too close together.
    """
    if len(shape) != cable.keypoints:
        raise TaskError(f"has {len(shape)} keypoints, not the {cable.keypoints} of cable.keypoints", (end,))
    _check_inside(end, shape, scene)
    curve = curve_through(shape, cable)
    _check_lengths(end, curve, cable)
    if polyline.crosses_itself(curve):
        raise TaskError("crosses itself", (end,))
    _check_apart(end, curve, cable)
    _check_bends(end, shape, cable)
    _check_free(end, curve, scene, cable.radius, grippers.radius)
    gap = float(np.linalg.norm(shape[-1] - shape[0]))
    if gap < grippers.least_span:
        needed = "grippers.separation" if grippers.separation == grippers.least_span else "two of grippers.radius,"
        raise TaskError(f"has its grippers {gap:.4f} m apart, less than {needed} {grippers.least_span:g} m", (end,))


def check_poses(end: str, poses: Float[np.ndarray, "2 3"], shape: Float[np.ndarray, "n 2"], cable: Cable) -> None:
    """Refuse stated gripper poses [m, m, rad] that are not those of the shape.

    Raises:
        TaskError: There are not two, or one is away from its end of the cable.
    """
    place = (f"{end}_poses",)
    if len(poses) != 2:
        raise TaskError(f"must be two poses (x, y, theta), got {len(poses)}", place)
    curve = curve_through(shape, cable)
    steps = curve[[1, -1]] - curve[[0, -2]]
    ends = np.column_stack([curve[[0, -1]], np.arctan2(steps[:, 1], steps[:, 0])])
    away, turned = SE2.distance(poses, ends)
    for i, side in enumerate(("left", "right")):
        if away[i] > POSE_TOLERANCE[0] or turned[i] > POSE_TOLERANCE[1]:
            raise TaskError(
                f"do not fit the keypoints: the {side} pose is {_millimetres(away[i])} and "
                f"{np.degrees(turned[i]):.0f} degrees off that end of the cable",
                place,
            )


def check_plug(end: str, pose: Float[np.ndarray, "3"], plug: Plug, scene: Scene) -> None:
    """Refuse a right end `pose` [m, m, rad] ahead of which the plug has no room.

    Raises:
        TaskError: The plug overlaps an obstacle or a wall.
    """
    line = plug.body.placed(pose, PLUG_SPACING)
    depth, index = scene.overlap(line, 0.0)
    met = np.flatnonzero(shapely.intersects(shapely.Polygon(line), np.array(scene.solids, dtype=object)))
    if depth > 0 or len(met):
        index = index if depth > 0 else int(met[0])
        raise TaskError(f"has its plug in {scene.name_of(index)} by {_millimetres(max(depth, 0.0))}", (end,))


def check_port(pose: Float[np.ndarray, "3"], plug: Plug, port: Port) -> None:
    """Refuse a right end `pose` [m, m, rad] of the goal that does not bring the plug before the port.

    Raises:
        TaskError: The plug's tip is not `standoff` before the mouth, or not in line with it.
    """
    wanted = port.pose(plug, -port.standoff)
    away, turned = SE2.distance(pose, wanted)
    if away > PORT_TOLERANCE or turned > POSE_TOLERANCE[1]:
        x, y, angle = wanted
        raise TaskError(
            f"must have its right end at ({x:.4f}, {y:.4f}), {angle:.3f} rad, where the plug is port.standoff before "
            f"the port; it is {_millimetres(float(away))} and {np.degrees(turned):.0f} degrees off",
            ("goal",),
        )


def end_pose(shape: Float[np.ndarray, "n 2"], cable: Cable) -> Float[np.ndarray, "3"]:
    """Position and direction [m, m, rad] of the right end of a cable through keypoints."""
    curve = curve_through(shape, cable)
    x, y = curve[-1] - curve[-2]
    return np.array([*curve[-1], np.arctan2(y, x)])


def curve_through(shape: Float[np.ndarray, "n 2"], cable: Cable) -> Float[np.ndarray, "m 2"]:
    """The cable through keypoints [m]: a spline, or the rod where there are too few of them or they are the rod's."""
    if len(shape) < SPLINE_KEYPOINTS or isinstance(cable, EstimatedCable):
        q, distance = fit_keypoints(cable.rod, shape)
        if distance <= ROD_TOLERANCE * cable.length:
            return cable.rod.shapes(q[None])[0][0]
    return polyline.spline(shape, SPLINE_PIECES)


def _check_inside(end: str, shape: Float[np.ndarray, "n 2"], scene: Scene) -> None:
    outside = (shape < 0).any(1) | (shape > scene.size).any(1)
    if outside.any():
        i = int(np.argmax(outside))
        raise TaskError(
            f"at ({shape[i, 0]:g}, {shape[i, 1]:g}) lies outside the workspace of "
            f"{scene.size[0]:g} m x {scene.size[1]:g} m",
            (end, i),
        )


def _check_lengths(end: str, curve: Float[np.ndarray, "m 2"], cable: Cable) -> None:
    segments = cable.keypoints - 1
    arc = polyline.arc_length(curve)
    if not abs(arc[-1] / cable.length - 1) <= LENGTH_TOLERANCE:
        raise TaskError(
            f"is {arc[-1]:.4f} m long, more than {LENGTH_TOLERANCE:.0%} off cable.length {cable.length:g} m", (end,)
        )
    pieces, wanted = np.diff(arc[:: (len(curve) - 1) // segments]), cable.length / segments
    i = int(np.argmax(np.abs(pieces - wanted)))
    if abs(pieces[i] / wanted - 1) > SPACING_TOLERANCE:
        raise TaskError(
            f"is not at equal arc length: keypoints {i} and {i + 1} are {pieces[i]:.4f} m apart along the cable, "
            f"not {wanted:.4f} m",
            (end,),
        )


def _check_apart(end: str, curve: Float[np.ndarray, "m 2"], cable: Cable) -> None:
    """Parts of the cable at least half a turn of its own thickness from each other do not touch."""
    arc = polyline.arc_length(curve)
    apart = np.linalg.norm(curve[:, None] - curve, axis=2)
    apart[np.abs(arc[:, None] - arc) < np.pi * cable.radius] = np.inf
    if apart.min() < 2 * cable.radius:
        x, y = curve[np.unravel_index(np.argmin(apart), apart.shape)[0]]
        raise TaskError(
            f"touches itself near ({x:.3f}, {y:.3f}): its centre line comes within {_millimetres(float(apart.min()))} "
            f"of itself, less than twice cable.radius {1000 * cable.radius:g} mm",
            (end,),
        )


def _check_bends(end: str, shape: Float[np.ndarray, "n 2"], cable: Cable) -> None:
    """The turn from chord to chord gives a mean curvature, which the greatest one exceeds."""
    steps = np.diff(shape, axis=0)
    turns = np.abs(se2.wrap_angle(np.diff(np.arctan2(steps[:, 1], steps[:, 0]))))
    i = int(np.argmax(turns))
    radius = cable.length / ((cable.keypoints - 1) * max(float(turns[i]), 1e-12))
    if radius < cable.min_bend_radius * (1 - LENGTH_TOLERANCE):
        raise TaskError(
            f"bends to a radius of {1000 * radius:.1f} mm at keypoint {i + 1}, below "
            f"cable.min_bend_radius {1000 * cable.min_bend_radius:g} mm",
            (end,),
        )


def _check_free(end: str, curve: Float[np.ndarray, "m 2"], scene: Scene, radius: float, gripper: float) -> None:
    depth, index = scene.overlap(curve, radius)
    if depth > 0:
        raise TaskError(f"overlaps {scene.name_of(index)} by {_millimetres(depth)}", (end,))
    for side, tip in (("left", curve[:1]), ("right", curve[-1:])):
        depth, index = scene.overlap(tip, gripper)
        if depth > 0:
            raise TaskError(f"has its {side} gripper in {scene.name_of(index)} by {_millimetres(depth)}", (end,))


def _millimetres(distance: float) -> str:
    return f"{1000 * distance:.1f} mm" if distance >= 5e-5 else "less than 0.1 mm"
