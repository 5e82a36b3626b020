"""The rod in space against a simulated chain that shares no code with it."""

from __future__ import annotations

import numpy as np
from spatial_chains import Chain

from cableway.geometry import rotations
from cableway.rod.continuation import lead
from cableway.rod.spatial import SpatialRod

ROD = SpatialRod(0.5, 13, 1.0, 18.5)


def drawn(count: int, stable: bool) -> np.ndarray:
    """Coordinates that are stable, or that are not."""
    rng = np.random.default_rng(7)
    spread = [*[0.3] * 3, *[1.2] * 3, *[8.0] * 3, *[2.0] * 3] if stable else [*[0.3] * 3, *[1.2] * 3, *[25.0] * 6]
    rows = rng.normal(0, spread, (400, 12))
    margins = ROD.stability(rows, ceiling=20.0)[0]
    return rows[margins > 5 if stable else (margins < -10) & (np.abs(rows[:, 9]) < 12)][:count]


def test_stable_shapes_stay_and_others_leave():
    rng = np.random.default_rng(0)
    for stable in (True, False):
        for q in drawn(2, stable):
            settled = Chain(ROD, q).settle(1.5, 0.3, rng)
            off = np.linalg.norm(settled - ROD.shapes(q[None])[0][0, 1::2], axis=1).max()
            assert (off < 0.0015) if stable else (off > 0.03)


def test_the_chain_snaps_where_the_rod_does():
    """An arch twisted by one gripper: short of there it stays, beyond it leaves."""
    q = drawn(6, stable=True)[5]
    pose = ROD.end_poses(q[None])[0]
    turns = rotations.from_vector(np.linspace(0, 4, 17)[:, None] * [1.0, 0.0, 0.0])
    poses = np.repeat(pose[None], len(turns), axis=0)
    poses[:, 1, 3:] = rotations.product(pose[1, 3:], turns)
    led = lead(ROD, q, poses)
    assert led.snap is not None
    assert led.stability[-1] < 0.35 * led.stability[0]
    last, rng = len(led.q) - 1, np.random.default_rng(0)
    for row, beyond in ((last - 2, 0), (last, 3)):
        chain = Chain(ROD, led.q[row])
        chain.lead_to(poses[row + beyond, 1])
        settled = chain.settle(1.2, 0.01, rng)
        off = np.linalg.norm(settled - ROD.shapes(led.q[[row]])[0][0, 1::2], axis=1).max()
        assert (off > 0.05) if beyond else (off < 0.002)
