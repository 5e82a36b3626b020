"""Passages: known gaps, the circumcircle rule, and which ones a path goes through."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cableway.planning.routes.passages import crossings, find_passages, traversed_passages
from cableway.records import Passage
from cableway.scene.obstacles import Box, Disc, Obstacle, Polygon
from cableway.scene.scene import Scene


def between(scene: Scene, i: int, j: int) -> Passage | None:
    """The passage between two obstacles, if there is one."""
    found = [passage for passage in find_passages(scene) if passage.between == (i, j)]
    return found[0] if found else None


LEFT, RIGHT = Box(center=(0.25, 0.35), size=(0.1, 0.2)), Box(center=(0.45, 0.40), size=(0.1, 0.2))


def test_two_boxes_have_the_gap_in_the_middle_of_where_their_edges_face():
    passage = between(Scene(obstacles=(LEFT, RIGHT)), 0, 1)
    assert passage is not None
    assert passage.width == pytest.approx(0.1)
    # the edges face each other from y = 0.30 to y = 0.45
    assert passage.ends == pytest.approx(np.array([[0.30, 0.375], [0.40, 0.375]]))


def test_two_discs_have_the_gap_on_the_line_of_their_centres():
    scene = Scene(obstacles=(Disc(center=(0.2, 0.2), radius=0.05), Disc(center=(0.5, 0.6), radius=0.1)))
    passage = between(scene, 0, 1)
    assert passage is not None
    assert passage.width == pytest.approx(0.5 - 0.15)
    assert np.linalg.norm(passage.ends[0] - [0.2, 0.2]) == pytest.approx(0.05)
    assert np.linalg.norm(passage.ends[1] - [0.5, 0.6]) == pytest.approx(0.1)


def test_a_corner_and_a_wall():
    triangle = Polygon(vertices=np.array([[0.1, 0.3], [0.2, 0.25], [0.2, 0.35]]))
    passage = between(Scene(obstacles=(triangle,)), 0, 1)
    assert passage is not None
    assert passage.ends == pytest.approx(np.array([[0.1, 0.3], [0.0, 0.3]]))


def test_there_is_no_passage_between_two_walls():
    assert find_passages(Scene()) == ()


def test_a_lone_box_has_a_passage_to_each_wall():
    scene = Scene(obstacles=(Box(center=(0.35, 0.35), size=(0.1, 0.1)),))
    assert [passage.between for passage in find_passages(scene)] == [(0, 1), (0, 2), (0, 3), (0, 4)]
    assert all(passage.width == pytest.approx(0.3) for passage in find_passages(scene))


@pytest.mark.parametrize(
    ("third", "valid"),
    [
        (Disc(center=(0.35, 0.34), radius=0.01), False),
        (Disc(center=(0.35, 0.43), radius=0.01), False),
        (Disc(center=(0.35, 0.45), radius=0.01), True),
    ],
)
def test_a_third_obstacle_in_the_circumcircle_makes_it_invalid(third: Obstacle, valid: bool):
    """The circle about (0.35, 0.375) has the radius 0.05."""
    assert (between(Scene(obstacles=(LEFT, RIGHT, third)), 0, 1) is not None) == valid


@pytest.mark.parametrize(
    "second", [Box(center=(0.3, 0.4), size=(0.1, 0.1)), Disc(center=(0.3, 0.35), radius=0.02), LEFT]
)
def test_obstacles_that_overlap_have_none(second: Obstacle):
    assert between(Scene(obstacles=(LEFT, second)), 0, 1) is None


def test_an_obstacle_against_a_wall_has_none_there():
    scene = Scene(obstacles=(Box(center=(0.35, 0.05), size=(0.1, 0.1)),))
    assert between(scene, 0, 2) is None
    assert between(scene, 0, 4) is not None


coordinate = st.floats(0.15, 0.55)


@given(coordinate, coordinate, coordinate, coordinate, st.floats(0, 3), st.floats(0, 3))
@settings(max_examples=60, deadline=None)
def test_order_of_the_obstacles_does_not_matter_and_ends_lie_on_them(
    ax: float, ay: float, bx: float, by: float, turn_a: float, turn_b: float
):
    a = Box(center=(ax, ay), size=(0.1, 0.05), angle=turn_a)
    b = Box(center=(bx, by), size=(0.02, 0.15), angle=turn_b)
    one, two = between(Scene(obstacles=(a, b)), 0, 1), between(Scene(obstacles=(b, a)), 0, 1)
    assert (one is None) == (two is None)
    if one is None or two is None:
        return
    assert one.ends == pytest.approx(two.ends[::-1], abs=1e-9)
    for end, obstacle in zip(one.ends, (a, b), strict=True):
        assert Scene(obstacles=(obstacle,)).signed_distance(end) == pytest.approx(0.0, abs=1e-9)
    middle = Scene(obstacles=(a, b)).signed_distance(one.ends.mean(axis=0))
    assert middle == pytest.approx(one.width / 2, abs=1e-6)


def test_traversed_passages_come_in_the_path_s_order_with_the_crossings():
    scene = Scene(obstacles=(LEFT, RIGHT))
    path = np.array([[0.35, 0.05], [0.35, 0.65], [0.60, 0.65], [0.60, 0.05]])
    names = [(passage.between, round(arc, 6)) for passage, arc in traversed_passages(find_passages(scene), path)]
    # gap of the boxes at y = 0.375; right box to the right wall (index 4) at y = 0.4, on the way down
    assert names[0] == ((0, 1), 0.325)
    assert ((1, 4), round(0.6 + 0.25 + 0.25, 6)) in names
    assert [arc for _, arc in names] == sorted(arc for _, arc in names)


def test_a_passage_left_on_the_same_side_is_not_traversed():
    passages = find_passages(Scene(obstacles=(LEFT, RIGHT)))
    gap = tuple(passage for passage in passages if passage.between == (0, 1))
    assert traversed_passages(gap, np.array([[0.34, 0.1], [0.35, 0.5], [0.36, 0.1]])) == []
    assert len(traversed_passages(gap, np.array([[0.34, 0.1], [0.35, 0.5], [0.36, 0.1], [0.35, 0.6]]))) == 1


def test_crossings_have_signs_and_count_a_vertex_on_the_segment_once():
    segment = np.array([[0.0, 0.0], [1.0, 0.0]])
    arcs, signs = crossings(np.array([[0.5, -1.0], [0.5, 0.0], [0.5, 1.0]]), segment)
    assert arcs.tolist() == [1.0]
    assert signs.tolist() == [1]
    arcs, signs = crossings(np.array([[0.5, 1.0], [0.5, -1.0]]), segment)
    assert signs.tolist() == [-1]
    assert len(crossings(np.array([[1.5, 1.0], [1.5, -1.0]]), segment)[0]) == 0
