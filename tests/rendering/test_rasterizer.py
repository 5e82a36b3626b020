"""Laws of cameras, surfaces and the rasteriser, against what is known in closed form."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cableway.core.errors import InputError
from cableway.rendering.camera import Camera
from cableway.rendering.mesh import Mesh, Surface, capsules, circle, prism, tube
from cableway.rendering.picture import NEAR, Light, Picture, render

LIGHT = Light(position=(0.5, -1.0, 3.0), shadows=0)
RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def camera(place: Any = (0.0, -2.0, 1.5), towards: Any = (0.0, 0.0, 0.0), size: tuple[int, int] = (320, 240)) -> Camera:
    at = np.array(place, float)
    return Camera.looking(at, np.array(towards, float) - at, size=size, view=0.9)


def rays(eye: Camera) -> np.ndarray:
    """(h, w, 3) directions in the world of the middles of all pixels, of length 1 along the camera's z axis."""
    u, v = np.meshgrid(np.arange(eye.size[0]), np.arange(eye.size[1]))
    (fx, fy), (cx, cy) = eye.focal, eye.center
    return np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(u.shape)], axis=2) @ eye.pose[:3, :3].T


def depth_of_plane(eye: Camera, height: float) -> np.ndarray:
    """Depth (h, w) of the horizontal plane at a height; infinite where a ray does not meet it."""
    down = rays(eye)[..., 2]
    with np.errstate(divide="ignore"):
        depth = (height - eye.pose[2, 3]) / down
    return np.where(depth > 0, depth, np.inf)


def ball(center: Any, radius: float, **detail: int) -> Surface:
    return capsules(np.array([[center, center]], float), np.array([radius]), **detail)


def table(size: float = 1.0, height: float = 0.0) -> Mesh:
    return prism(size * SQUARE, (height - 0.1, height)).painted(RED, 1)


def test_the_depth_of_a_plane_is_that_of_the_rays():
    eye = camera()
    seen = render(table(), eye, LIGHT)
    wanted = depth_of_plane(eye, 0.0)
    at = eye.pose[:3, 3] + wanted[..., None] * rays(eye)
    inside = np.isfinite(wanted) & (np.abs(at[..., :2]).max(axis=2) < 1 - 1e-9)
    assert inside.sum() > 20000
    assert np.allclose(seen.depth[inside], wanted[inside], rtol=0, atol=1e-12)
    assert (seen.label[inside] == 1).all()


def test_the_depth_of_a_sphere_is_that_of_the_rays_but_for_its_facets():
    eye, center, radius, sides, rings = camera(), np.array([0.1, 0.0, 0.2]), 0.4, 128, 32
    seen = render(ball(center, radius, sides=sides, rings=rings).painted(RED, 3), eye, LIGHT)
    ray, off = rays(eye), eye.pose[:3, 3] - center
    a, b, c = (ray**2).sum(axis=2), ray @ off, off @ off - radius**2
    within = b**2 - a * c
    wanted = (-b - np.sqrt(np.maximum(within, 0))) / a
    facing = np.abs(ray @ off + wanted * a) / np.sqrt(a) / radius  # cosine of the angle between ray and normal
    clear = (within > 0) & (facing > 0.3)
    sag = radius * (1 - np.cos(np.pi / sides) * np.cos(np.pi / 4 / rings))
    error = seen.depth[clear] - wanted[clear]
    assert clear.sum() > 3000
    assert error.min() >= -1e-9, "facets lie inside the sphere"
    assert error.max() <= sag / 0.3 * 1.5
    assert (seen.label[within < 0] == 0).all()
    assert np.isinf(seen.depth[within < 0]).all()


def test_a_point_is_seen_where_it_is_projected():
    eye, places = camera(), np.array([[0.3, 0.2, 0.1], [-0.4, 0.1, 0.3], [0.0, -0.5, 0.05]])
    mesh = Mesh.joined(ball(at, 0.03).painted(BLUE, 2 + k) for k, at in enumerate(places))
    seen = render(mesh, eye, LIGHT)
    pixels, depth = eye.project(places)
    for k, (u, v) in enumerate(pixels):
        rows, columns = np.nonzero(seen.label == 2 + k)
        assert (columns.mean(), rows.mean()) == pytest.approx((u, v), abs=0.3)
        assert seen.depth[round(v), round(u)] == pytest.approx(depth[k] - 0.03, abs=0.002)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_the_nearer_thing_is_seen_whatever_the_order(order: tuple[int, int]):
    parts = [table(), prism(0.2 * SQUARE, (0.0, 0.3)).painted(BLUE, 2)]
    eye = camera()
    seen = render(Mesh.joined(parts[k] for k in order), eye, LIGHT)
    (u, v), depth = eye.project(np.array([0.0, 0.0, 0.3]))
    assert seen.label[round(float(v)), round(float(u))] == 2
    assert seen.depth[round(float(v)), round(float(u))] == pytest.approx(float(depth), abs=0.01)
    for y, label in ((0.5, 2), (0.9, 1)):  # of the table, in the shade of the block and past it
        (u, v), _ = eye.project(np.array([0.0, y, 0.0]))
        assert seen.label[round(float(v)), round(float(u))] == label


def test_nothing_behind_the_camera_is_drawn():
    eye = camera(towards=(0.0, -4.0, 1.5))
    seen = render(Mesh.joined([table(), ball((0, 0, 0.5), 0.3).painted(BLUE, 2)]), eye, LIGHT, background=BLUE)
    assert not seen.label.any()
    assert np.isinf(seen.depth).all()
    assert (seen.color == (0, 0, 255)).all()


def test_a_floor_that_runs_on_behind_the_camera_is_cut_where_the_camera_begins_to_see():
    eye = camera(place=(0.0, 0.0, 0.02), towards=(0.0, 1.0, 0.0))
    seen = render(table(50.0), eye, LIGHT)
    wanted = depth_of_plane(eye, 0.0)
    floor = (wanted > NEAR) & (wanted < 45)
    assert floor[-1].all()
    assert floor.sum() > 20000
    assert np.allclose(seen.depth[floor], wanted[floor], rtol=1e-9)
    low = camera(place=(0.0, 0.0, 0.001), towards=(0.0, 1.0, 0.0))  # the nearest floor is nearer than that
    near = depth_of_plane(low, 0.0)
    cut = render(table(50.0), low, LIGHT)
    assert cut.depth.min() >= NEAR - 1e-12
    assert np.array_equal(cut.label[near < 40] == 1, near[near < 40] >= NEAR)


SURFACES = {
    "prism": (prism(SQUARE, (0.1, 0.6)), 4 * 0.5),
    "cylinder": (prism(circle((1, 2), 0.3, 200), (0, 2), rounded=True), np.pi * 0.09 * 2),
    "tube": (tube(np.linspace([0, 0, 0], [1, 2, 2], 9), 0.1, 100), np.pi * 0.01 * 3),
    "bent tube": (
        tube(np.column_stack([np.cos(t := np.linspace(0, 3, 90)), np.sin(t), 0 * t]), 0.1, 90), np.pi * 0.01 * 3
    ),
    "capsule": (
        capsules(np.array([[[0, 0, 0], [1, 2, 2.0]]]), np.array([0.2]), sides=90, rings=30),
        np.pi * 0.04 * 3 + 4 / 3 * np.pi * 0.008,
    ),
    "ball": (ball((1, 0, 0), 0.5, sides=90, rings=30), 4 / 3 * np.pi * 0.125),
}  # fmt: skip


def test_a_tube_that_folds_back_or_turns_sharply_is_still_one():
    for points in ([[0, 0, 0], [1, 0, 0], [0, 0, 0]], [[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 1], [0, 1, 1]]):
        surface = tube(np.array(points, float), 0.1)
        assert np.isfinite(surface.corners).all()
        assert np.allclose(np.linalg.norm(surface.normals, axis=2), 1)


@pytest.mark.parametrize(("surface", "volume"), SURFACES.values(), ids=SURFACES.keys())
def test_surfaces_are_closed_and_turned_outwards(surface: Surface, volume: float):
    points = np.round(surface.corners, 9) + 0.0
    names = [[tuple(corner) for corner in triangle] for triangle in points.tolist()]
    names = [triangle for triangle in names if len(set(triangle)) == 3]
    edges = Counter((triangle[i], triangle[(i + 1) % 3]) for triangle in names for i in range(3))
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)
    a, b, c = surface.corners.swapaxes(0, 1)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(volume, rel=0.01)
    assert np.allclose(np.linalg.norm(surface.normals, axis=2), 1)
    flat = np.cross(b - a, c - a)
    assert (np.einsum("ij,ikj->ik", flat, surface.normals) >= -1e-12).all()


def test_a_closed_surface_has_no_holes():
    eye, center, sides, rings = camera(), np.array([0.03, 0.01, 0.2]), 17, 5
    seen = render(ball(center, 0.5, sides=sides, rings=rings).painted(RED, 1), eye, LIGHT)
    inner = 0.5 * np.cos(np.pi / sides) * np.cos(np.pi / 4 / rings)
    ray, off = rays(eye), eye.pose[:3, 3] - center
    hit = (ray @ off) ** 2 > (ray**2).sum(axis=2) * (off @ off - inner**2)
    assert hit.sum() > 3000
    assert (seen.label[hit] == 1).all()


def test_a_matt_surface_is_as_bright_as_lambert_says_and_dark_in_the_shadow():
    """A wall between lamp and table: its shadow is where the rays of the lamp end."""
    light = Light(position=(-2.0, 0.0, 2.0), ambient=0.4, shadows=1024)
    wall = prism(np.array([[-0.02, -0.5], [0.02, -0.5], [0.02, 0.5], [-0.02, 0.5]]), (0.0, 0.3)).painted(BLUE, 2)
    eye = camera(place=(0.0, -0.5, 3.0))
    seen = render(Mesh.joined([table(), wall]), eye, light)

    def red(x: float, y: float) -> float:
        (u, v), _ = eye.project(np.array([x, y, 0.0]))
        return float(seen.color[round(float(v)), round(float(u)), 0])

    end = 0.02 + 0.3 * 2.02 / (2.0 - 0.3)  # of the shadow at y = 0
    for x in (-0.5, end + 0.03, 0.8):
        lit = 2.0 / np.hypot(x + 2.0, 2.0)
        assert red(x, 0.0) == pytest.approx(255 * (0.4 + 0.6 * lit), abs=1.5)
    for x in (0.05, 0.2, end - 0.03):
        assert red(x, 0.0) == pytest.approx(255 * 0.4, abs=1)


def scene() -> Mesh:
    return Mesh.joined([table(), ball((0.1, 0.2, 0.3), 0.3).painted(BLUE, 2)])


def render_scene(**options: Any) -> Picture:
    return render(scene(), camera(), replace(LIGHT, shadows=256), **options)


def test_samples_smooth_edges_and_change_neither_depth_nor_label():
    one, nine = render_scene(), render_scene(samples=3)
    assert np.array_equal(one.label, nine.label)
    assert np.allclose(one.depth, nine.depth, rtol=1e-12)
    assert np.abs(one.color.astype(int) - nine.color).mean() < 2
    edge = (one.label[:, 1:] != one.label[:, :-1]).any(axis=1)
    assert len(np.unique(nine.color[edge].reshape(-1, 3), axis=0)) > len(
        np.unique(one.color[edge].reshape(-1, 3), axis=0)
    )


def test_the_same_scene_gives_the_same_picture():
    for one, other in zip(*(vars(render_scene(samples=3)).values() for _ in range(2)), strict=True):
        assert np.array_equal(one, other)


@pytest.mark.parametrize("size", [(300, 300), (500, 200), (200, 500)])
def test_a_framing_camera_has_all_points_in_its_picture_and_is_no_farther_away_than_it_must(size: tuple[int, int]):
    points = np.random.default_rng(5000).uniform(-1, 1, (40, 3))
    eye = Camera.framing(points, np.array([0.3, 1.0, -0.7]), size=size, view=0.6, margin=0.05)
    pixels, depth = eye.project(points)
    low, high = (pixels.min(axis=0) + 0.5) / size, (pixels.max(axis=0) + 0.5) / size
    assert depth.min() > 0
    assert (low >= 0.05 - 1e-9).all()
    assert (high <= 0.95 + 1e-9).all()
    assert np.maximum(0.05 - low, high - 0.95).max() == pytest.approx(0, abs=1e-9)


def test_a_camera_that_looks_straight_down_has_y_upwards():
    eye = camera(place=(0.0, 0.0, 2.0))
    (left, middle, top), _ = eye.project(np.array([[-0.1, 0, 0], [0, 0, 0], [0, 0.1, 0]]))
    assert left[0] < middle[0]
    assert top[1] < middle[1]
    assert middle == pytest.approx(eye.center)
    behind, depth = eye.project(np.array([0.0, 0.0, 3.0]))
    assert np.isnan(behind).all()
    assert depth == pytest.approx(-1.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"size": (0, 10)}, r"size of a camera must be two positive whole numbers, got \(0, 10\)"),
        ({"focal": (1.0, np.nan)}, "focal of a camera must be two positive numbers"),
        ({"center": (np.inf, 0.0)}, "center of a camera must be two finite numbers"),
        ({"pose": np.full((4, 4), np.nan)}, "pose of a camera must be 4 x 4 finite numbers"),
        ({"pose": np.diag([1.0, 1.0, -1.0, 1.0])}, "must be a rotation and a translation"),
        ({"pose": 2 * np.eye(4)}, "must be a rotation and a translation"),
    ],
)
def test_what_is_no_camera(change: dict[str, Any], message: str):
    given = {"size": (4, 3), "focal": (2.0, 2.0), "center": (1.5, 1.0), "pose": np.eye(4)}
    Camera(**given)  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match=message):
        Camera(**given | change)


def test_what_cannot_be_rendered():
    with pytest.raises(InputError, match="samples must be an odd number, 1 for none that smooth edges, got 2"):
        render_scene(samples=2)
    with pytest.raises(InputError, match="corners of a mesh must be finite"):
        render(replace(table(), corners=np.full((12, 3, 3), np.nan)), camera(), LIGHT)
    with pytest.raises(InputError, match="colours of a mesh and a background must be from 0 to 1"):
        render_scene(background=(0.0, 0.0, 255.0))
    with pytest.raises(InputError, match="ambient must be from 0 to 1, got 2"):
        Light(position=(0, 0, 1), ambient=2.0)
    with pytest.raises(InputError, match="position of a light must be three finite numbers"):
        Light(position=(0, 0, np.inf))
    with pytest.raises(InputError, match="shadows must not be negative"):
        Light(position=(0, 0, 1), shadows=-1)
    with pytest.raises(InputError, match=r"margin must be from 0 to less than 0\.5, got 0\.5"):
        Camera.framing(np.zeros((1, 3)), np.ones(3), size=(4, 4), view=1.0, margin=0.5)
    with pytest.raises(InputError, match="view of a camera must be between 0 and pi rad"):
        Camera.looking(np.zeros(3), np.ones(3), size=(4, 4), view=4.0)
    with pytest.raises(InputError, match="direction of a camera must be finite and not zero"):
        Camera.looking(np.zeros(3), np.zeros(3), size=(4, 4), view=1.0)
