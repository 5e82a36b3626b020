"""Videos of runs as a camera would have taken them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from cableway.datasets.lerobot import RATE, Film
from cableway.datasets.runs import StoredRun
from cableway.figures.film import write_film
from cableway.tracking.photographer import EyesConfig, Photographer, State

SOME = 5
"""Frames of a run that statistics are taken of."""


def filmed_by(camera: str) -> Film:
    """What writes the video of a run by a camera.

    Args:
        camera: Where it stands, one of `cableway.perception.placement.PLACES`.

    Raises:
        UnknownNameError: There is no such place.
    """
    config = EyesConfig(cameras=(camera,), blur=0.0, noise=0.0)

    def film(run: StoredRun, path: Path) -> UInt8[np.ndarray, "k h w 3"]:
        assert run.rollout is not None
        kept: list[np.ndarray] = []
        chosen = set(np.linspace(0, run.rollout.steps - 1, SOME).astype(int).tolist())

        def frames() -> Iterator[np.ndarray]:
            for k, picture in enumerate(_pictures(run, config)):
                if k in chosen:
                    kept.append(picture)
                yield picture

        write_film(path, RATE, frames())
        return np.stack(kept)

    return film


def _pictures(run: StoredRun, config: EyesConfig) -> Iterator[UInt8[np.ndarray, "h w 3"]]:
    """Of each control step, before it."""
    rollout = run.rollout
    assert rollout is not None
    photographer, rng = Photographer(run.task, None, config), np.random.default_rng(0)
    for k in range(rollout.steps):
        state = State(float(rollout.times[k]), rollout.centreline[k], rollout.poses[k], None)
        yield photographer.pictures(state, rng)[0]
