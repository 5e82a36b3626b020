"""Rigid bodies that move with a gripper: convex outlines on its frame, between two heights.

A body's outline is a convex polygon with its vertices counter-clockwise, grown by a rounding radius; a disc is one
vertex with a rounding. The gripper's disc and the plug are bodies. Search, optimisation, controllers, watchdog and
simulator read them from `Task.bodies`, so that a new shape is one more body.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from cableway.core.compiled import inlined
from cableway.geometry import se2
from cableway.geometry.convex import (
    ConvexWorld,
    convex_distance,
    distance_at,
    segment_clearance,
    segment_distance,
    signed_distance,
)
from cableway.geometry.convex import pack as pack_world
from cableway.geometry.groups import SE2

LEFT, RIGHT = 0, 1
"""The gripper that a body moves with."""


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid convex body on the frame of a gripper.

    Attributes:
        name: For messages, such as "left gripper".
        side: `LEFT` or `RIGHT`.
        outline: (k, 2) vertices [m] in the gripper's frame, counter-clockwise; x points along the cable's tangent.
        rounding: By which the outline is grown [m].
        heights: Lowest and highest point above the table [m].
    """

    name: str
    side: int
    outline: Float[np.ndarray, "k 2"]
    rounding: float = 0.0
    heights: tuple[float, float] = (-math.inf, math.inf)

    @classmethod
    def disc(cls, name: str, side: int, radius: float) -> Body:
        """A disc of a radius [m] about the origin of the frame."""
        return cls(name, side, np.zeros((1, 2)), radius)

    @classmethod
    def box(cls, name: str, side: int, length: float, width: float) -> Body:
        """A rectangle `length` [m] ahead of the origin of the frame, `width` [m] across."""
        half = width / 2
        return cls(name, side, np.array([[0.0, -half], [length, -half], [length, half], [0.0, half]]))

    def boundary(self, spacing: float) -> Float[np.ndarray, "m 2"]:
        """Points [m] at most `spacing` apart round the outline, the last one the first again, in the frame.

        >>> Body.box("plug", RIGHT, 0.04, 0.01).boundary(0.04).tolist()
        [[0.0, -0.005], [0.04, -0.005], [0.04, 0.005], [0.0, 0.005], [0.0, -0.005]]
        """
        corners = np.vstack([self.outline, self.outline[:1]])
        sides = []
        for a, b in pairwise(corners):
            count = max(1, int(np.ceil(np.linalg.norm(b - a) / spacing - 1e-9)))
            sides.append(a + np.arange(count)[:, None] / count * (b - a))
        return np.vstack([*sides, corners[:1]])

    def placed(self, poses: Float[np.ndarray, "... 3"], spacing: float = math.inf) -> Float[np.ndarray, "... m 2"]:
        """`boundary` [m] with the frame at `poses` [m, m, rad]; the one vertex of a disc where it is a disc."""
        points = self.outline if len(self.outline) == 1 else self.boundary(spacing)
        return out_of_frame(points, np.asarray(poses, float)[..., None, :])

    @cached_property
    def world(self) -> ConvexWorld:
        """The body as the one obstacle of a world without walls, in its frame."""
        return pack_world([self.outline], [self.rounding], (1.0, 1.0), (math.inf, -math.inf))

    @property
    def reach(self) -> float:
        """Farthest point of the body from the origin of its frame [m]."""
        return float(np.linalg.norm(self.outline, axis=1).max()) + self.rounding

    @cached_property
    def circle(self) -> tuple[Float[np.ndarray, "2"], float]:
        """A circle that holds the body: its centre in the frame and its radius [m].

        >>> Body.box("plug", RIGHT, 0.04, 0.03).circle
        (array([0.02, 0.  ]), 0.025)
        """
        centre = (self.outline.min(axis=0) + self.outline.max(axis=0)) / 2
        return centre, float(np.linalg.norm(self.outline - centre, axis=1).max()) + self.rounding

    def meets(self, other: Body) -> bool:
        """Whether the two are pieces of different grippers, both more than a disc, with a height in common.

        Discs are kept apart by `Grippers.least_span`.
        """
        (low, high), (other_low, other_high) = self.heights, other.heights
        solid = min(len(self.outline), len(other.outline)) > 1
        return solid and self.side != other.side and low < other_high and other_low < high

    def meets_cable(self, radius: float) -> bool:
        """Whether it is more than a disc and comes as low as a cable of a radius [m] that lies on the table."""
        return len(self.outline) > 1 and self.heights[0] < 2 * radius

    def covers(self, other: Body) -> bool:
        """Whether the outline of another body of the same gripper lies within that of this one."""
        if self.side != other.side or len(self.outline) == 1:
            return False
        return bool(signed_distance(other.outline, self.world)[0].max() + other.rounding <= 0)


def body_pairs(bodies: Sequence[Body]) -> tuple[tuple[Body, Body], ...]:
    """The pairs of bodies, the left gripper's first, that could meet, without those that others always meet before."""
    pairs = [(a, b) for a in bodies for b in bodies if a.side == LEFT and a.meets(b)]
    kept: list[tuple[Body, Body]] = []
    for i, (a, b) in enumerate(pairs):
        wider = (pair for j, pair in enumerate(pairs) if j > i or pair in kept)
        if not any(c.covers(a) and d.covers(b) and (c, d) != (a, b) for c, d in wider):
            kept.append((a, b))
    return tuple(kept)


def outer_bodies(bodies: Sequence[Body], heights: Sequence[float | None]) -> tuple[Body, ...]:
    """The bodies without those that no obstacle can touch, or only one that another body of the same gripper touches.

    Args:
        bodies: The bodies.
        heights: Of obstacles and walls [m], None for unlimited.
    """
    tops = np.array([math.inf if height is None else height for height in heights])
    kept: list[Body] = []
    for i, body in enumerate(bodies):
        met = tops > body.heights[0]
        wider = (other for j, other in enumerate(bodies) if (j > i or other in kept) and other.covers(body))
        if met.any() and not any((met <= (tops > other.heights[0])).all() for other in wider):
            kept.append(body)
    return tuple(kept)


def into_frame(points: Float[np.ndarray, "... m 2"], poses: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... m 2"]:
    """Points [m] of the world in the frames at `poses` [m, m, rad]."""
    offset, angle = points - SE2.position(poses)[..., None, :], poses[..., 2, None]
    along, aside = se2.direction(angle), se2.direction(angle + np.pi / 2)
    return np.stack([np.sum(offset * along, axis=-1), np.sum(offset * aside, axis=-1)], axis=-1)


def out_of_frame(points: Float[np.ndarray, "... 2"], poses: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 2"]:
    """Points [m] of frames at `poses` [m, m, rad] in the world."""
    x, y = points[..., :1], points[..., 1:]
    return SE2.position(poses) + x * se2.direction(poses[..., 2]) + y * se2.direction(poses[..., 2] + np.pi / 2)


class PackedBodies(NamedTuple):
    """Bodies for the compiled kernels, each with the distance that its outline keeps.

    Attributes:
        side: (b,) gripper that each moves with.
        outline: (b, v, 2) [m] in its frame, rows past `counts` unused.
        counts: (b,) vertices of each.
        distance: (b,) [m] that its outline keeps from obstacles and walls, the rounding included; minus infinity where
            that is not asked.
        lowest: (b,) height of its lowest point above the table [m].
        pairs: (p, 2) indices of the left and the right body of those that could meet.
        over: (o,) indices of those that could meet the cable.
        arc: (o,) length of the cable [m], from the end that its gripper holds, that such a body does not meet.
    """

    side: Int[np.ndarray, "b"]
    outline: Float[np.ndarray, "b v 2"]
    counts: Int[np.ndarray, "b"]
    distance: Float[np.ndarray, "b"]
    lowest: Float[np.ndarray, "b"]
    pairs: Int[np.ndarray, "p 2"]
    over: Int[np.ndarray, "o"]
    arc: Float[np.ndarray, "o"]


def pack(
    bodies: Sequence[Body], distance: Sequence[float], pairs: Sequence[tuple[Body, Body]], radius: float, margin: float
) -> PackedBodies:
    """Pack bodies with the distance [m] that each outline keeps.

    Args:
        bodies: The bodies.
        distance: Of each.
        pairs: Those that could meet.
        radius: Of the cable [m].
        margin: Clearance [m] that bodies keep from the cable.
    """
    outline, counts = padded([body.outline for body in bodies])
    sides = np.array([body.side for body in bodies], dtype=np.int64)
    order = {id(body): index for index, body in enumerate(bodies)}
    places = np.array([(order[id(a)], order[id(b)]) for a, b in pairs], dtype=np.int64).reshape(-1, 2)
    over = [index for index, body in enumerate(bodies) if body.meets_cable(radius)]
    arc = [held_arc(bodies[index], radius, margin) for index in over]
    lowest = np.array([body.heights[0] for body in bodies], dtype=float)
    kept, near = np.array(distance, float), (np.array(over, np.int64), np.array(arc, float))
    return PackedBodies(sides, outline, counts, kept, lowest, places, *near)


def padded(
    outlines: Sequence[Float[np.ndarray, "_ 2"]],
) -> tuple[Float[np.ndarray, "b v 2"], Int[np.ndarray, "b"]]:
    """Outlines [m] as one array, rows past the number of vertices of each unused, and those numbers."""
    counts = np.array([len(outline) for outline in outlines], dtype=np.int64)
    packed = np.zeros((len(outlines), int(counts.max(initial=1)), 2))
    for row, outline in zip(packed, outlines, strict=True):
        row[: len(outline)] = outline
    return packed, counts


def held_arc(body: Body, radius: float, margin: float) -> float:
    """Length of the cable [m], from the end that its gripper holds, that leaves a body with a clearance of `margin`."""
    return body.reach + radius + margin


@inlined
def bodies_keep_distance(poses, bodies, world):
    """Whether all bodies keep their distance from obstacles and walls with the grippers at `poses` (2, 3)."""
    vertices, counts, rounding, _, _, heights = world
    for b in range(len(bodies.side)):
        pose, count, wanted, lowest = poses[bodies.side[b]], bodies.counts[b], bodies.distance[b], bodies.lowest[b]
        if wanted == -np.inf:
            continue
        c, s = math.cos(pose[2]), math.sin(pose[2])
        outline = bodies.outline[b]
        ax = pose[0] + c * outline[count - 1, 0] - s * outline[count - 1, 1]
        ay = pose[1] + s * outline[count - 1, 0] + c * outline[count - 1, 1]
        if count == 1:
            if distance_at(ax, ay, world, lowest) < wanted:
                return False
            continue
        for i in range(count):
            bx = pose[0] + c * outline[i, 0] - s * outline[i, 1]
            by = pose[1] + s * outline[i, 0] + c * outline[i, 1]
            if segment_clearance(ax, ay, bx, by, world, wanted, lowest)[0] < wanted:
                return False
            ax, ay = bx, by
        for k in range(len(counts)):  # one that stands inside the outline
            if heights[k] > lowest:
                dx, dy = vertices[k, 0, 0] - pose[0], vertices[k, 0, 1] - pose[1]
                x, y = c * dx + s * dy, c * dy - s * dx
                if convex_distance(x, y, outline, count, 0.0)[0] - rounding[k] < wanted:
                    return False
    return True


@inlined
def bodies_keep_apart(poses, bodies, wanted):
    """Whether the bodies of the two grippers, at `poses` (2, 3), keep a distance from each other."""
    for p in range(len(bodies.pairs)):
        a, b = bodies.pairs[p, 0], bodies.pairs[p, 1]
        left, right, count = poses[bodies.side[a]], poses[bodies.side[b]], bodies.counts[b]
        turn = right[2] - left[2]
        c, s, cl, sl = math.cos(turn), math.sin(turn), math.cos(left[2]), math.sin(left[2])
        dx, dy = right[0] - left[0], right[1] - left[1]
        ox, oy = cl * dx + sl * dy, cl * dy - sl * dx
        outline = bodies.outline[b]
        ax = ox + c * outline[count - 1, 0] - s * outline[count - 1, 1]
        ay = oy + s * outline[count - 1, 0] + c * outline[count - 1, 1]
        for i in range(count):
            bx, by = ox + c * outline[i, 0] - s * outline[i, 1], oy + s * outline[i, 0] + c * outline[i, 1]
            if segment_distance(ax, ay, bx, by, bodies.outline[a], bodies.counts[a], 0.0) < wanted:
                return False
            ax, ay = bx, by
        dx, dy = bodies.outline[a, 0, 0] - ox, bodies.outline[a, 0, 1] - oy  # one inside the other
        if convex_distance(c * dx + s * dy, c * dy - s * dx, outline, count, 0.0)[0] < wanted:
            return False
    return True


@inlined
def bodies_keep_off(stations, poses, bodies, length, wanted):
    """Whether the cable through stations (s, 2), as long as `length`, keeps a distance from what could meet it."""
    last = len(stations) - 1
    for o in range(len(bodies.over)):
        b = bodies.over[o]
        pose, first = poses[bodies.side[b]], math.ceil(bodies.arc[o] * last / length)
        c, s = math.cos(pose[2]), math.sin(pose[2])
        for i in range(first, last + 1):
            j = i if bodies.side[b] == LEFT else last - i
            dx, dy = stations[j, 0] - pose[0], stations[j, 1] - pose[1]
            if convex_distance(c * dx + s * dy, c * dy - s * dx, bodies.outline[b], bodies.counts[b], 0.0)[0] < wanted:
                return False
    return True
