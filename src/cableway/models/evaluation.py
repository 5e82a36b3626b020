"""Open-loop error of deformation models against the horizon, over whole episodes of a data set."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from cableway.errors import InputError
from cableway.models.base import DeformationModel, rollout
from cableway.models.baselines import Persistence, RigidBlend
from cableway.models.dataset import window_starts, windows
from cableway.records import Transitions

HORIZONS = (1, 5, 10, 20, 30)
"""Horizons [control steps] at which models are compared; the paper shows up to about 30."""

WINDOW_STRIDE = 10
"""Steps between the starts of two windows of one episode."""

BATCH = 512
"""Windows predicted at once."""


@dataclass(frozen=True, kw_only=True)
class HorizonError:
    """Error ||predicted - true|| over all 2n numbers (stacked) after `horizon` steps, in millimetres.

    Attributes:
        horizon: Steps predicted without looking.
        median: [mm].
        mean: [mm].
        p95: 95th percentile [mm].
        worst: [mm].
        count: Number of windows.
    """

    horizon: int
    median: float
    mean: float
    p95: float
    worst: float
    count: int


def baselines() -> dict[str, DeformationModel]:
    """The models that every learned one is compared with, by name."""
    return {"persistence": Persistence(), "rigid blend": RigidBlend()}


def evaluate(
    models: Mapping[str, DeformationModel],
    data: Transitions,
    horizons: tuple[int, ...] = HORIZONS,
    stride: int = WINDOW_STRIDE,
) -> dict[str, tuple[HorizonError, ...]]:
    """Open-loop errors of each model at each horizon that some episode of `data` is long enough for.

    Args:
        models: Models by name.
        data: Transitions; those of one episode follow each other.
        horizons: Numbers of steps.
        stride: Steps between the starts of two windows of one episode.

    Raises:
        InputError: No episode is as long as the shortest horizon.
    """
    used = [h for h in sorted(horizons) if len(window_starts(data.episode, h, stride))]
    if not used:
        raise InputError(f"no episode of the data has {min(horizons)} or more steps")
    table: dict[str, tuple[HorizonError, ...]] = {}
    for name, model in models.items():
        table[name] = tuple(_summary(h, open_loop_errors(model, data, h, stride)) for h in used)
    return table


def open_loop_errors(
    model: DeformationModel, data: Transitions, horizon: int, stride: int = WINDOW_STRIDE
) -> Float[np.ndarray, "k"]:
    """Stacked error [m] after `horizon` steps from every `stride`-th row of each episode."""
    starts = window_starts(data.episode, horizon, stride)
    errors = []
    for first in range(0, len(starts), BATCH):
        rows = starts[first : first + BATCH]
        padded = np.pad(rows, (0, BATCH - len(rows)), mode="edge") if first else rows
        part = windows(data, padded, horizon)
        predicted = _predict(model, part.keypoints, part.poses, part.actions)
        left = np.asarray(predicted, float)[: len(rows)] - data.next_keypoints[rows + horizon - 1]
        errors.append(np.linalg.norm(left.reshape(len(rows), -1), axis=1))
    return np.concatenate(errors)


@eqx.filter_jit
def _predict(model: DeformationModel, keypoints: Array, poses: Array, actions: Array) -> Array:
    """Shapes after the last action of each window."""
    return jax.vmap(lambda *window: rollout(model, *window)[-1])(keypoints, poses, actions)


def _summary(horizon: int, errors: Float[np.ndarray, "k"]) -> HorizonError:
    millimetres = 1e3 * errors
    return HorizonError(
        horizon=horizon,
        median=float(np.median(millimetres)),
        mean=float(np.mean(millimetres)),
        p95=float(np.percentile(millimetres, 95)),
        worst=float(np.max(millimetres)),
        count=len(errors),
    )
