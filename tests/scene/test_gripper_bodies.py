"""Bodies of grippers: read and written, as Shapely has them, and no piece left out that something could touch first."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import cableway as cw
from cableway.core.errors import TaskError
from cableway.scene.bodies import LEFT, RIGHT, Body, body_pairs, outer_bodies
from cableway.scene.clearance import bodies_gap, body_clearance, pieces_clearance
from cableway.scene.gripper_bodies import GRIPPER_BODIES, OPENINGS, TIP, BodyPart, gripper_body, open_hand
from cableway.scene.grippers import Grippers
from cableway.scene.obstacles import Box, Disc
from cableway.scene.scene import Scene
from cableway.tasks.generation import random_task

LAWS = settings(deadline=None, max_examples=50)
SQUARE = [[-0.02, -0.02], [0.02, -0.02], [0.02, 0.02], [-0.02, 0.02]]
POSTS = Scene(
    (0.7, 0.7),
    (
        Disc(center=(0.3, 0.3), radius=0.004, height=0.03),  # fits into a hand
        Box(center=(0.5, 0.4), size=(0.1, 0.05), angle=0.3, height=0.07),
        Box(center=(0.2, 0.5), size=(0.1, 0.1)),
    ),
    0.05,
)
places = arrays(float, (4, 2, 3), elements=st.floats(0.1, 0.6), unique=True)


def outline(body: Body, pose: np.ndarray) -> shapely.Polygon:
    turned = np.array([[np.cos(pose[2]), np.sin(pose[2])], [-np.sin(pose[2]), np.cos(pose[2])]])
    return shapely.Polygon(pose[:2] + body.outline @ turned)


@LAWS
@given(places)
def test_a_body_is_as_far_from_what_is_as_high_as_shapely_says(poses: np.ndarray):
    for body in Grippers(body="2f-85").bodies:
        if len(body.outline) == 1:
            continue
        found = body_clearance(body, poses, POSTS)
        met = [s for s, o in zip(POSTS.solids, POSTS.obstacles, strict=True) if (o.height or 9) > body.heights[0]]
        for clearance, pose in zip(found, poses[:, body.side], strict=True):
            shape = outline(body, pose)
            gaps = [shape.distance(solid) for solid in met]
            if body.heights[0] < 0.05:
                gaps.append(shape.distance(shapely.box(0, 0, *POSTS.size).exterior))
            assert max(clearance, 0.0) == pytest.approx(min(gaps), abs=2e-5)


@LAWS
@given(places, st.sampled_from([None, 0.01, 0.05, 0.09]))
def test_what_is_left_out_touches_nothing_first(poses: np.ndarray, height: float | None):
    """Of the pieces the outer ones, and of the pairs those that are kept."""
    scene = replace(POSTS, obstacles=tuple(replace(o, height=height) for o in POSTS.obstacles))
    pieces = [body for body in Grippers(body="2f-85").bodies if len(body.outline) > 1]
    kept = outer_bodies(pieces, scene.heights)
    assert len(kept) < len(pieces)
    all_of, outer = (np.array([body_clearance(body, poses, scene) for body in some]) for some in (pieces, kept))
    np.testing.assert_allclose(np.maximum(outer.min(axis=0), 0), np.maximum(all_of.min(axis=0), 0), atol=1e-12)
    every = [(a, b) for a in pieces for b in pieces if a.side == LEFT and a.meets(b)]
    near = poses * [0.3, 0.3, 1.0]
    gaps = [np.maximum(bodies_gap(pairs, near), 0.0) for pairs in (body_pairs(pieces), every)]
    np.testing.assert_allclose(*gaps, atol=1e-12)


@LAWS
@given(places)
def test_two_hands_are_as_far_apart_as_shapely_says(poses: np.ndarray):
    poses = poses * [0.3, 0.3, 1.0]
    pairs = body_pairs(Grippers(body="2f-85").bodies)
    for gap, (left, right) in zip(bodies_gap(pairs, poses), poses, strict=True):
        exact = min(outline(a, left).distance(outline(b, right)) for a, b in pairs)
        assert max(gap, 0.0) == pytest.approx(exact, abs=2e-5)


def test_an_obstacle_inside_the_outline_is_touched():
    body = Body("hand", LEFT, np.array(SQUARE))
    assert body_clearance(body, np.array([[[0.3, 0.3, 0.5]] * 2]), POSTS)[0] < 0


def test_a_low_obstacle_is_passed_over():
    body = Body("hand", RIGHT, np.array(SQUARE), heights=(0.03, 0.1))
    assert body_clearance(body, np.array([[[0.3, 0.3, 0.5]] * 2]), POSTS)[0] > 0.05


@pytest.mark.parametrize("body", [*GRIPPER_BODIES, (BodyPart(outline=np.array(SQUARE), heights=(0.0, 0.05)),), None])
def test_a_task_is_read_as_it_was_written(tmp_path: Path, body: str | tuple[BodyPart, ...] | None):
    task = random_task(0, "posts")
    written = replace(task, grippers=replace(task.grippers, body=body))
    written.save(tmp_path / "task.yaml")
    assert cw.load_task(tmp_path / "task.yaml") == written


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (
            "2f-58",
            "grippers.body must be one of disc, 2f-85, 2f-85-long-fingers, hand-e, or a list of pieces, got '2f-58'",
        ),
        ([{"outline": SQUARE, "heights": [0.05, 0.0]}], "grippers.body[0].heights must be in order, got [0.05, 0]"),
        ([{"outline": SQUARE[:2], "heights": [0, 1]}], "grippers.body[0].outline must be at least 3 points, got 2"),
        ([{"outline": SQUARE}], "grippers.body[0].heights is missing; it must be [lowest, highest]"),
        (3, "grippers.body must be disc, 2f-85, 2f-85-long-fingers, hand-e, or a list of pieces, got 3"),
    ],
)
def test_what_is_no_body_is_refused(tmp_path: Path, body: object, said: str):
    path = tmp_path / "task.yaml"
    random_task(0, "posts").save(path)
    content = yaml.safe_load(path.read_text())
    content["grippers"]["body"] = body
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(TaskError) as refused:
        cw.load_task(path)
    assert said in str(refused.value)


def test_ends_at_which_a_hand_stands_on_something_are_refused():
    task = random_task(0, "posts")
    post = Disc(center=tuple(task.start[0] + [0.0, 0.03]), radius=0.01, height=0.2)
    with pytest.raises(TaskError, match=r"start has its left gripper in obstacles\[\d+\] \(disc"):
        replace(task, scene=replace(task.scene, obstacles=(*task.scene.obstacles, post)))
    near = replace(task.grippers, body=(BodyPart(outline=np.array(SQUARE) * 8, heights=(0.1, 0.2)),))
    with pytest.raises(TaskError, match="has its left gripper in its right gripper"):
        replace(task, grippers=near, scene=Scene((0.9, 0.9), (), 0.001))
    low = replace(
        task.grippers, body=(BodyPart(outline=np.array(SQUARE) * [6, 0.2] + [0.14, 0], heights=(0.002, 0.01)),)
    )
    with pytest.raises(TaskError, match="gripper on the cable"):
        replace(task, grippers=low, scene=Scene((0.9, 0.9), (), 0.001))


def test_a_disc_has_no_pieces():
    task = random_task(0, "clutter")
    assert np.isinf(pieces_clearance(task.start[None], task.gripper_poses("start")[None], task)).all()


FINGER = (
    (25.0, 9.49, 26.07), (25.0, -9.51, 26.07), (25.0, 9.37, 46.99), (30.5, 10.49, 44.0), (31.0, -0.01, 46.5),
    (31.0, 9.99, 28.6), (30.53, -10.51, 45.12), (29.79, 9.49, 17.77), (34.53, 9.99, 21.56), (35.48, 10.48, 19.26),
    (35.8, -10.01, 16.81), (35.8, 9.99, 1.0), (29.8, -9.51, 12.0), (35.82, -10.51, 5.3), (32.32, -18.74, 5.3),
    (32.98, -16.27, 7.8), (24.45, -15.68, 8.2), (18.29, -15.24, 5.22), (20.09, -18.73, 5.3), (21.66, -10.1, 8.48),
)  # fmt: skip
"""Corners [mm] of a finger of the Hand-E, 50 mm open, from the middle of the hand's face: along the fingers' motion,
across it and away from the face, which is 47 mm from the tips."""


@pytest.mark.parametrize("opening", [0.008, *OPENINGS])
def test_the_outlines_of_the_hand_e_hold_its_fingers_closed_and_open(opening: float):
    parts = gripper_body("hand-e") if opening == 0.008 else open_hand("hand-e", opening)
    assert len(parts) == (4 if opening == 0.008 else 7)
    for aside, along, up in FINGER:
        moved, height = aside - 25 + 500 * opening, TIP + (47 - up) / 1000
        for side in (1, -1):
            point = shapely.Point(side * along / 1000, side * moved / 1000)
            near = (part for part in parts if part.heights[0] - 1e-4 <= height <= part.heights[1] + 1e-4)
            assert any(shapely.Polygon(part.outline).buffer(1e-4).contains(point) for part in near)
    fingers = [part for part in parts if part.heights[1] < 0.045]
    if opening != 0.008:
        assert 2 * min(np.abs(part.outline[:, 1]).min() for part in fingers) == pytest.approx(opening)
    radius = np.linalg.norm(parts[-1].outline, axis=1).max()
    assert radius * np.cos(np.pi / 12) == pytest.approx(0.0375)
