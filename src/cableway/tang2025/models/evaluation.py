"""Open-loop error of deformation models against the horizon, over whole episodes of a data set."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from cableway.core.errors import InputError
from cableway.records import Transitions
from cableway.tang2025.models.base import DeformationModel, rollout
from cableway.tang2025.models.baselines import Persistence, RigidBlend
from cableway.tang2025.models.dataset import window_starts

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
        errors = open_loop_errors(model, data, tuple(used), stride)
        table[name] = tuple(_summary(h, errors[h]) for h in used)
    return table


def open_loop_errors(
    model: DeformationModel, data: Transitions, horizons: tuple[int, ...], stride: int = WINDOW_STRIDE
) -> dict[int, Float[np.ndarray, "k"]]:
    """Stacked error [m] after each number of steps, from every `stride`-th row of each episode that is long enough."""
    stacked = window_errors(model, data, horizons, stride).stacked
    return {h: row[np.isfinite(row)] for h, row in zip(horizons, stacked.T, strict=True)}


class WindowErrors(NamedTuple):
    """Errors of windows; NaN where the episode ends before the horizon.

    Attributes:
        episode: (k,) number of each window's episode.
        stacked: (k, H) L2 over all 2n numbers [m] after each horizon.
        mean: (k, H) mean over the keypoints of their distances [m].
    """

    episode: Float[np.ndarray, "k"]
    stacked: Float[np.ndarray, "k H"]
    mean: Float[np.ndarray, "k H"]


def window_errors(
    model: DeformationModel, data: Transitions, horizons: tuple[int, ...], stride: int = WINDOW_STRIDE
) -> WindowErrors:
    """Open-loop errors from every `stride`-th row of each episode that is as long as the shortest horizon."""
    starts = window_starts(data.episode, min(horizons), stride)
    fits = np.stack([np.isin(starts, window_starts(data.episode, h, stride)) for h in horizons], axis=1)
    last = len(data) - 1
    distances = []
    for first in range(0, len(starts), BATCH):
        rows = starts[first : first + BATCH]
        padded = np.pad(rows, (0, BATCH - len(rows)), mode="edge") if first else rows
        actions = data.actions[np.minimum(padded[:, None] + np.arange(max(horizons)), last)]
        predicted = _predict(model, data.keypoints[padded], data.poses[padded], actions, horizons)
        true = data.next_keypoints[np.minimum(rows[:, None] + np.array(horizons) - 1, last)]
        distances.append(np.linalg.norm(np.asarray(predicted, float)[: len(rows)] - true, axis=3))
    distance = np.where(fits[..., None], np.concatenate(distances), np.nan)
    return WindowErrors(data.episode[starts], np.sqrt(np.sum(distance**2, axis=2)), np.mean(distance, axis=2))


@eqx.filter_jit
def _predict(
    model: DeformationModel,
    keypoints: Array | np.ndarray,
    poses: Array | np.ndarray,
    actions: Array | np.ndarray,
    horizons: tuple[int, ...],
) -> Array:
    """Shapes after the given numbers of actions of each window; what lies past an episode's end is not used."""
    chosen = np.array(horizons) - 1
    return jax.vmap(lambda *window: rollout(model, *window)[chosen])(keypoints, poses, actions)


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
