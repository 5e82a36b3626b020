"""Transitions of cables led at random, made without a simulator."""

from __future__ import annotations

import numpy as np

from cableway.datasets.transitions import Transitions
from cableway.rod.planar import PlanarRod


def quasi_static(episodes: int, steps: int, *, seed: int, length: float = 0.3, keypoints: int = 13) -> Transitions:
    """Transitions of a cable without lag: straight lines in rod coordinates, one for each episode."""
    rng, rod = np.random.default_rng(seed), PlanarRod(length, keypoints)
    parts = []
    for _ in range(episodes):
        start = np.concatenate([rng.uniform(0.2, 0.5, 2), rng.uniform(-3, 3, 1), rng.normal(0, [6, 6, 1.5])])
        change = rng.normal(0, [0.05, 0.05, 0.4, 4, 4, 1])
        q = start + np.linspace(0, 1, steps + 1)[:, None] * change
        stations, poses = rod.shapes(q)
        parts.append((rod.at_keypoints(stations), poses))
    shapes, poses = (np.array(part) for part in zip(*parts, strict=True))
    return Transitions(
        keypoints=shapes[:, :-1].reshape(-1, keypoints, 2),
        poses=poses[:, :-1].reshape(-1, 2, 3),
        actions=np.diff(poses, axis=1).reshape(-1, 2, 3),
        next_keypoints=shapes[:, 1:].reshape(-1, keypoints, 2),
        episode=np.repeat(np.arange(episodes), steps),
    )
