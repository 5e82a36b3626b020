"""Whether a start or goal shape is one that the cable can have in its scene."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from jaxtyping import Float

from cableway.core.errors import Point, TaskError
from cableway.core.quantities import limit_text, place, quantity, size_text, told_apart
from cableway.geometry import polyline, se2
from cableway.geometry.groups import SE2
from cableway.rod.inverse import fit_keypoints
from cableway.scene.bodies import LEFT, Body, body_pairs, held_arc
from cableway.scene.cable import Cable, EstimatedCable
from cableway.scene.grippers import Grippers, Plug, Port
from cableway.scene.scene import Overlap, Scene

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

OUTLINE_SPACING = 0.002
"""Distance [m] of the points round a body at which the depth of an overlap is measured."""

PORT_TOLERANCE = 5e-3
"""How far [m] the right end of the goal may be from where the plug is before the port."""


def shape_faults(
    end: str, shape: Float[np.ndarray, "n 2"], scene: Scene, cable: Cable, grippers: Grippers
) -> Iterator[TaskError]:
    """Why the cable cannot have keypoints [m] in the scene; `end` ("start" or "goal") names them.

    Wrong number of keypoints, outside the workspace, wrong length, not at equal arc length, crossing or touching
    itself, bent too sharply, overlapping an obstacle or wall, or grippers too close together.
    """
    if len(shape) != cable.keypoints:
        yield TaskError(f"has {len(shape)} keypoints, not the {cable.keypoints} of cable.keypoints", (end,))
        return
    outside = list(_outside(end, shape, scene))
    curve = curve_through(shape, cable)
    yield from outside
    yield from _wrong_length(end, curve, cable)
    yield from _touching_itself(end, curve, cable)
    yield from _bent_sharply(end, shape, cable)
    if not outside:
        yield from _overlaps(end, curve, scene, cable.radius, grippers.radius)
    gap = float(np.linalg.norm(shape[-1] - shape[0]))
    if gap < grippers.least_span:
        needed = "grippers.separation" if grippers.separation == grippers.least_span else "two of grippers.radius,"
        yield TaskError(
            f"has its grippers {told_apart(gap, grippers.least_span)} apart, less than {needed} "
            f"{limit_text(grippers.least_span)}",
            (end,),
            at=_point((shape[0] + shape[-1]) / 2),
        )


def pose_faults(
    end: str, poses: Float[np.ndarray, "2 3"], shape: Float[np.ndarray, "n 2"], cable: Cable
) -> Iterator[TaskError]:
    """Where stated gripper poses [m, m, rad] are not those of the shape."""
    away, turned = SE2.distance(poses, end_poses(shape, cable))
    for i, side in enumerate(("left", "right")):
        if away[i] > POSE_TOLERANCE[0] or turned[i] > POSE_TOLERANCE[1]:
            yield TaskError(
                f"do not fit the keypoints: the {side} pose is {_millimetres(away[i])} and "
                f"{quantity(turned[i], 'rad')} off that end of the cable",
                (f"{end}_poses",),
                at=_point(poses[i]),
            )


def body_faults(end: str, poses: Float[np.ndarray, "2 3"], bodies: Sequence[Body], scene: Scene) -> Iterator[TaskError]:
    """Where a body with the ends at `poses` [m, m, rad] overlaps an obstacle, a wall or a body of the other gripper.

    Discs are left to `shape_faults`.
    """
    solid = [body for body in bodies if len(body.outline) > 1]
    for name in dict.fromkeys(body.name for body in solid):
        found = [_body_overlap(body, poses[body.side], scene) for body in solid if body.name == name]
        overlap = max((each for each in found if each is not None), default=None)
        if overlap is not None:
            depth, index, at = overlap
            yield TaskError(f"has its {name} in {scene.name_of(index)} by {_millimetres(depth)}", (end,), at=at)
    for one, other in body_pairs(solid):
        both = [shapely.Polygon(body.placed(poses[body.side])) for body in (one, other)]
        common = both[0].intersection(both[1])
        if common.area > 0:
            place = shapely.get_coordinates(common.centroid)[0]
            yield TaskError(f"has its {one.name} in its {other.name}", (end,), at=_point(place))
            return


def body_on_cable_faults(
    end: str, shape: Float[np.ndarray, "n 2"], poses: Float[np.ndarray, "2 3"], bodies: Sequence[Body], cable: Cable
) -> Iterator[TaskError]:
    """Where a body stands on the cable, but for the piece that its own gripper holds."""
    curve = curve_through(shape, cable)
    arc = polyline.arc_length(curve)
    for body in bodies:
        if not body.meets_cable(cable.radius):
            continue
        from_end = arc if body.side == LEFT else arc[-1] - arc
        free = curve[from_end >= held_arc(body, cable.radius, 0.0)]
        outline = shapely.Polygon(body.placed(poses[body.side]))
        if len(free) > 1 and shapely.LineString(free).distance(outline) < cable.radius:
            yield TaskError(f"has its {body.name} on the cable", (end,), at=_point(poses[body.side]))
            return


def _body_overlap(body: Body, pose: Float[np.ndarray, "3"], scene: Scene) -> Overlap | None:
    """How deep a body is in an obstacle or a wall that is as high as it is low; None where it is in none."""
    line, lowest = body.placed(pose, OUTLINE_SPACING), body.heights[0]
    found = scene.overlap(line, 0.0, lowest)
    if found.depth > 0:
        return found
    higher = np.array([height is None or height > lowest for height in scene.heights[:-1]], dtype=bool)
    met = np.flatnonzero(higher & shapely.intersects(shapely.Polygon(line), np.array(scene.solids, dtype=object)))
    return Overlap(0.0, int(met[0]), found.at) if len(met) else None


def port_faults(pose: Float[np.ndarray, "3"], plug: Plug, port: Port) -> Iterator[TaskError]:
    """Whether a right end `pose` [m, m, rad] of the goal brings the plug `standoff` before the mouth and in line."""
    wanted = port.pose(plug, -port.standoff)
    away, turned = map(float, SE2.distance(pose, wanted))
    if away > PORT_TOLERANCE or turned > POSE_TOLERANCE[1]:
        yield TaskError(
            f"must have its right end at {place(wanted[:2])}, {quantity(wanted[2], 'rad')}, where the plug is "
            f"port.standoff before the port; it is {_millimetres(away)} and {quantity(turned, 'rad')} off",
            ("goal",),
            at=_point(pose),
        )


def end_poses(shape: Float[np.ndarray, "n 2"], cable: Cable) -> Float[np.ndarray, "2 3"]:
    """Positions and directions [m, m, rad] of both ends of a cable through keypoints."""
    return polyline.end_poses(curve_through(shape, cable))


def curve_through(shape: Float[np.ndarray, "n 2"], cable: Cable) -> Float[np.ndarray, "m 2"]:
    """The cable through keypoints [m]: a spline, or the rod where a spline does not do and the keypoints are the rod's.

    A spline does where there are enough keypoints, of a uniform rod, and it is as long as the cable. It is too short
    where the cable is pulled taut, since all that bends lies between the outermost keypoints.
    """
    spline = polyline.spline(shape, SPLINE_PIECES)
    if len(shape) < SPLINE_KEYPOINTS or isinstance(cable, EstimatedCable) or not _is_as_long(spline, cable):
        q, distance = fit_keypoints(cable.rod, shape)
        if distance <= ROD_TOLERANCE * cable.length:
            return cable.rod.shapes(q[None])[0][0]
    return spline


def _is_as_long(curve: Float[np.ndarray, "m 2"], cable: Cable) -> bool:
    return bool(abs(polyline.arc_length(curve)[-1] / cable.length - 1) <= LENGTH_TOLERANCE)


def _outside(end: str, shape: Float[np.ndarray, "n 2"], scene: Scene) -> Iterator[TaskError]:
    outside = (shape < 0).any(1) | (shape > scene.size).any(1)
    if outside.any():
        i = int(np.argmax(outside))
        yield TaskError(
            f"at {place(shape[i])} lies outside the workspace of {size_text(scene.size)}",
            (end, i),
            at=_point(shape[i]),
        )


def _wrong_length(end: str, curve: Float[np.ndarray, "m 2"], cable: Cable) -> Iterator[TaskError]:
    segments = cable.keypoints - 1
    each = (len(curve) - 1) // segments
    arc = polyline.arc_length(curve)
    if not _is_as_long(curve, cable):
        yield TaskError(
            f"is {told_apart(arc[-1], cable.length)} long, more than {LENGTH_TOLERANCE:.0%} off cable.length "
            f"{limit_text(cable.length)}",
            (end,),
            at=_point(curve[len(curve) // 2]),
        )
        return
    pieces, wanted = np.diff(arc[::each]), cable.length / segments
    i = int(np.argmax(np.abs(pieces - wanted)))
    if abs(pieces[i] / wanted - 1) > SPACING_TOLERANCE:
        yield TaskError(
            f"is not at equal arc length: keypoints {i} and {i + 1} are {told_apart(pieces[i], wanted)} apart along "
            f"the cable, not {limit_text(wanted)}",
            (end,),
            at=_point(curve[each * i + each // 2]),
        )


def _touching_itself(end: str, curve: Float[np.ndarray, "m 2"], cable: Cable) -> Iterator[TaskError]:
    """Parts of the cable at least half a turn of its own thickness from each other do not touch."""
    if polyline.crosses_itself(curve):
        yield TaskError("crosses itself", (end,), at=_crossing(curve))
        return
    arc = polyline.arc_length(curve)
    apart = np.linalg.norm(curve[:, None] - curve, axis=2)
    apart[np.abs(arc[:, None] - arc) < np.pi * cable.radius] = np.inf
    if apart.min() < 2 * cable.radius:
        one, other = np.unravel_index(np.argmin(apart), apart.shape)
        yield TaskError(
            f"touches itself near {place(curve[one])}: its centre line comes within {_millimetres(float(apart.min()))} "
            f"of itself, less than twice cable.radius {limit_text(cable.radius)}",
            (end,),
            at=_point((curve[one] + curve[other]) / 2),
        )


def _crossing(curve: Float[np.ndarray, "m 2"]) -> Point:
    """Where a curve first crosses itself [m]."""
    segments = np.asarray(shapely.linestrings(np.stack([curve[:-1], curve[1:]], axis=1)))
    first, second = np.sort(shapely.STRtree(segments).query(segments, predicate="intersects"), axis=0)
    k = np.lexsort((second, first))
    k = k[second[k] > first[k] + 1][0]
    return _point(shapely.get_coordinates(shapely.intersection(segments[first[k]], segments[second[k]]))[0])


def _bent_sharply(end: str, shape: Float[np.ndarray, "n 2"], cable: Cable) -> Iterator[TaskError]:
    """The turn from chord to chord gives a mean curvature, which the greatest one exceeds."""
    steps = np.diff(shape, axis=0)
    turns = np.abs(se2.wrap_angle(np.diff(np.arctan2(steps[:, 1], steps[:, 0]))))
    i = int(np.argmax(turns))
    radius = cable.length / ((cable.keypoints - 1) * max(float(turns[i]), 1e-12))
    if radius < cable.min_bend_radius * (1 - LENGTH_TOLERANCE):
        yield TaskError(
            f"bends to a radius of {told_apart(radius, cable.min_bend_radius)} at keypoint {i + 1}, below "
            f"cable.min_bend_radius {limit_text(cable.min_bend_radius)}",
            (end,),
            at=_point(shape[i + 1]),
        )


def _overlaps(
    end: str, curve: Float[np.ndarray, "m 2"], scene: Scene, radius: float, gripper: float
) -> Iterator[TaskError]:
    depth, index, at = scene.overlap(curve, radius)
    if depth > 0:
        yield TaskError(f"overlaps {scene.name_of(index)} by {_millimetres(depth)}", (end,), at=at)
    for side, tip in (("left", curve[:1]), ("right", curve[-1:])):
        depth, index, at = scene.overlap(tip, gripper)
        if depth > 0:
            problem = f"has its {side} gripper in {scene.name_of(index)} by {_millimetres(depth)}"
            yield TaskError(problem, (end,), at=at)


def _point(point: Float[np.ndarray, "..."]) -> Point:
    return float(point[0]), float(point[1])


def _millimetres(distance: float) -> str:
    return quantity(distance) if distance >= 5e-5 else "less than 0.1 mm"
