"""The chain in MuJoCo bends, holds and measures distance as the rod and the scene do."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from cableway.core.errors import InputError, SimulationError
from cableway.rod.inverse import equilibria_at
from cableway.scene.cable import Cable
from cableway.scene.obstacles import Box, Disc, Polygon
from cableway.scene.scene import Scene
from cableway.simulation.chain import Chain, chain_coordinates

OBSTACLES = {
    "box": Box(center=(0.35, 0.35), size=(0.2, 0.1), angle=0.4),
    "polygon": Polygon(vertices=np.array([[0.25, 0.3], [0.45, 0.25], [0.5, 0.35], [0.4, 0.45], [0.3, 0.42]])),
    "disc": Disc(center=(0.35, 0.35), radius=0.08),
}


def random_q(rng: np.random.Generator, rod, least_stability: float = -np.inf) -> np.ndarray:
    while True:
        q = np.concatenate([rng.uniform(0.2, 0.5, 2), rng.uniform(-3, 3, 1), rng.normal(0, [8, 8, 2])])
        if rod.stability(q[None])[0][0] > least_stability:
            return q


def led(chain: Chain, line: np.ndarray, wait: int) -> np.ndarray:
    """Lay the chain at the first row of a line in q, lead it along, wait; its last centreline."""
    chain.place(line[0])
    poses = chain.rod.shapes(line[1:])[1]
    rows = chain.advance(np.concatenate([poses, np.repeat(poses[-1:], wait, axis=0)]))
    return chain.polylines(rows[-1:])


@pytest.mark.parametrize("keypoints", [13, 10, 3])
def test_coordinates_of_an_equilibrium_give_its_shape(keypoints):
    rod = Cable(keypoints=keypoints).rod
    chain = Chain(Cable(keypoints=keypoints), None, 0.005)
    q = random_q(np.random.default_rng(keypoints), rod)
    stations, poses = rod.shapes(q[None])
    coordinates = chain_coordinates(rod, q)[None]
    lines = chain.polylines(coordinates)
    np.testing.assert_allclose(lines[0, 1:-1], stations[0, 1::2], atol=1e-14)
    np.testing.assert_allclose(chain.keypoints(lines)[0], rod.at_keypoints(stations)[0], atol=1e-14)
    np.testing.assert_allclose(chain.end_poses(coordinates, lines)[0], poses[0], atol=1e-13)


def test_an_equilibrium_stays_where_it_is(bent):
    chain = Chain(Cable(), None, 0.005)
    before = chain.polylines(chain_coordinates(chain.rod, bent)[None])
    poses = chain.place(bent)
    after = chain.polylines(chain.advance(np.repeat(poses[None], 400, axis=0))[-1:])
    np.testing.assert_allclose(after, before, atol=1e-6)


def test_a_settled_shape_is_the_rods_equilibrium():
    """At N = 24, led along random lines: the same chain, so far closer than the 0.5 mm asked for."""
    rng = np.random.default_rng(0)
    chain = Chain(Cable(), None, 0.005)
    for _ in range(4):
        ends = [random_q(rng, chain.rod, 25.0) for _ in range(2)]
        line = ends[0] + np.linspace(0, 1, 400)[:, None] * (ends[1] - ends[0])
        if chain.rod.stability(line)[0].min() < 15:
            continue
        reached = chain.keypoints(led(chain, line, 600))[0]
        wanted = chain.rod.at_keypoints(chain.rod.shapes(line[-1:])[0])[0]
        assert np.linalg.norm(reached - wanted, axis=1).mean() < 2e-5


@pytest.mark.parametrize("shortening", [0.05, 0.2, 0.4])
def test_clamped_parallel_ends_pushed_together_follow_the_closed_form(shortening):
    """d/L = 2 (1 - E/K), h/L = k/K with the complete elliptic integrals of modulus k."""
    k = brentq(lambda k: 2 * (1 - ellipe(k * k) / ellipk(k * k)) - shortening, 1e-6, 0.999)
    height = k / ellipk(k * k)
    cable = Cable()
    chain = Chain(cable, None, 0.005)
    gap = cable.length * (1 - np.array([shortening / 2, shortening]))
    poses = np.array([[[0.2, 0.2, 0.0], [0.2 + g, 0.2, 0.0]] for g in gap])
    found = [q for q in equilibria_at(cable.rod, poses[0]) if chain.rod.shapes(q[None])[0][0, :, 1].max() > 0.201]
    start = chain.place(found[0])
    path = start + np.linspace(0, 1, 400)[:, None, None] * (poses[1] - start)
    rows = chain.advance(np.concatenate([path, np.repeat(path[-1:], 400, axis=0)]))
    middle = chain.keypoints(chain.polylines(rows[-1:]))[0, 6]
    assert middle[0] == pytest.approx(0.2 + gap[1] / 2, abs=1e-4)
    assert (middle[1] - 0.2) / cable.length == pytest.approx(height, abs=0.003)


def test_the_lag_grows_with_the_damping_time(bent):
    """Halfway through a fast motion a cable of larger tau is farther behind its equilibrium; later neither is."""
    target = bent + np.array([0.0, 0.0, 0.0, 6.0, -4.0, -2.0])
    line = bent + np.linspace(0, 1, 100)[:, None] * (target - bent)
    lag, late = [], []
    for tau in (0.05, 0.1, 0.4):
        cable = Cable(damping_time=tau)
        chain = Chain(cable, None, 0.005)
        wanted = cable.rod.at_keypoints(cable.rod.shapes(line[-1:])[0])[0]
        for rows, wait in ((lag, 1), (late, 800)):
            reached = chain.keypoints(led(chain, line, wait))[0]
            rows.append(np.linalg.norm(reached - wanted, axis=1).max())
    assert 1.5 * lag[0] < lag[1]
    assert 1.5 * lag[1] < lag[2]
    assert max(late) < 1e-3


def test_relaxation_after_a_step_is_first_order_with_tau():
    """Displaced and held, a cable comes back by exp(-t/tau): the chain's inertia is negligible beside its damping."""
    tau = 0.4
    cable = Cable(damping_time=tau)
    chain = Chain(cable, None, 0.005)
    q = np.array([0.35, 0.35, 0.0, -12.0, 0.0, -2.0])
    moved = q + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.3])
    poses = chain.place(q)
    target = cable.rod.shapes(moved[None])[1][0]
    path = poses + np.linspace(0, 1, 5)[1:, None, None] * (target - poses)
    rows = chain.advance(np.concatenate([path, np.repeat(path[-1:], 320, axis=0)]))
    wanted = chain.polylines(chain_coordinates(cable.rod, moved)[None])
    off = np.linalg.norm(chain.polylines(rows) - wanted, axis=(1, 2))
    times = np.array([0.2, 0.6])
    first, second = off[(times / 0.005).astype(int)]
    assert np.log(first / second) == pytest.approx((times[1] - times[0]) / tau, rel=0.1)


@pytest.mark.parametrize("name", OBSTACLES)
def test_mujoco_and_the_scene_agree_on_distance(name):
    """For cables that are clear or touch by less than their radius; box, polygon and disc, and the walls."""
    cable, scene = Cable(), Scene((0.7, 0.7), (OBSTACLES[name],))
    chain = Chain(cable, scene, 0.005)
    model, data = chain.model, mujoco.MjData(chain.model)
    links = [g for g in range(model.ngeom) if model.geom_bodyid[g] > 0]
    fixed = [g for g in range(model.ngeom) if model.geom_bodyid[g] == 0]
    assert len(fixed) == 5
    rng = np.random.default_rng(1)
    compared = 0
    for _ in range(60):
        q = np.concatenate([rng.uniform(0.1, 0.6, 2), rng.uniform(-3, 3, 1), rng.normal(0, [8, 8, 2])])
        data.qpos[:] = chain_coordinates(chain.rod, q)
        ours = scene.clearance(chain.polylines(data.qpos[None]), cable.radius)[0]
        if ours > -cable.radius:
            mujoco.mj_kinematics(model, data)
            theirs = min(mujoco.mj_geomDistance(model, data, a, b, 1.0, None) for a in links for b in fixed)
            assert ours == pytest.approx(theirs, abs=1e-6)
            compared += 1
    assert compared > 20


def test_a_bad_state_is_reported_and_leaves_no_file(bent, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    chain = Chain(Cable(), None, 0.005)
    poses = chain.place(bent)
    good = chain.save()
    bad = good.copy()
    bad[1 + len(chain.coordinates)] = np.nan
    chain.restore(bad)
    with pytest.raises(SimulationError, match="diverged"):
        chain.advance(poses[None])
    chain.restore(good)
    assert np.isfinite(chain.advance(poses[None])).all()
    assert list(tmp_path.iterdir()) == []


def test_a_state_of_another_model_is_refused():
    chain, other = Chain(Cable(), None, 0.005), Chain(Cable(keypoints=10), None, 0.005)
    with pytest.raises(InputError, match="shape"):
        chain.restore(other.save())
