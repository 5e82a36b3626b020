"""Open-loop error of deformation models against the horizon, with its spread over episodes and training seeds."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from cableway.core.bootstrap import intervals
from cableway.core.errors import InputError
from cableway.datasets.transitions import Transitions
from cableway.tang2025.models.base import DeformationModel, Persistence, RigidBlend, rollout
from cableway.tang2025.models.dataset import window_starts

HORIZONS = (1, 5, 10, 20, 30)
"""Horizons [control steps] at which models are compared; the paper shows up to about 30."""

WINDOW_STRIDE = 10
"""Steps between the starts of two windows of one episode."""

LONGEST = 50
"""Steps that models are compared over at most."""

SHARES = {"median": 0.5, "p95": 0.95}
"""Quantiles of which an interval is given."""

Ends = tuple[tuple[float | None, ...], ...]
"""Lower and upper ends of intervals, one for each horizon."""

BATCH = 512
"""Windows predicted at once."""


@dataclass(frozen=True)
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


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Error of one model, trained with one or several seeds, against the horizon, in millimetres.

    Attributes:
        horizons: Steps predicted without looking, from 1.
        median: Of the stacked error over all windows and seeds [mm].
        mean: Of the same [mm].
        p95: 95th percentile of the same [mm].
        worst: Of the same [mm].
        keypoint_mean: Mean distance of a keypoint [mm].
        above_blend: Mean difference to the stacked error of the rigid blend in the same windows [mm]; below 0 where the
            model predicts better.
        intervals: Lower and upper ends of the 95% intervals of `median`, `mean`, `p95` and `above_blend` [mm], by
            resampling the episodes: windows of one episode are alike. Not known (None) of a single episode.
        quartiles: First and third quartile of the episodes' mean stacked errors [mm].
        seeds: Least and greatest of the seeds' mean stacked errors [mm].
        windows: Number of windows of each horizon, for one seed.
        episodes: Number of episodes that they are from.
        trainings: Number of seeds.
    """

    horizons: tuple[int, ...]
    median: tuple[float, ...]
    mean: tuple[float, ...]
    p95: tuple[float, ...]
    worst: tuple[float, ...]
    keypoint_mean: tuple[float, ...]
    above_blend: tuple[float, ...]
    intervals: dict[str, Ends]
    quartiles: tuple[tuple[float, ...], tuple[float, ...]]
    seeds: tuple[tuple[float, ...], tuple[float, ...]]
    windows: tuple[int, ...]
    episodes: tuple[int, ...]
    trainings: int

    def at(self, horizon: int) -> dict[str, float]:
        """The figures at one horizon."""
        i = self.horizons.index(horizon)
        return {name: getattr(self, name)[i] for name in ("median", "mean", "p95", "worst", "keypoint_mean")}

    def interval(self, name: str, horizon: int) -> tuple[float | None, float | None]:
        """The interval of `median`, `mean` or `p95` at one horizon [mm]."""
        low, high = (end[self.horizons.index(horizon)] for end in self.intervals[name])
        return low, high


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
    used = _reached(data, sorted(horizons), stride)
    if not used:
        raise InputError(f"no episode of the data has {min(horizons)} or more steps")
    curves = {name: _curve([window_errors(model, data, used, stride)], used) for name, model in models.items()}
    return {
        name: tuple(map(HorizonError, used, curve.median, curve.mean, curve.p95, curve.worst, curve.windows))
        for name, curve in curves.items()
    }


def compare(
    models: Mapping[str, Sequence[DeformationModel]],
    data: Transitions,
    longest: int = LONGEST,
    stride: int = WINDOW_STRIDE,
) -> dict[str, Curve]:
    """A curve for each name; its models are the same, trained with different seeds.

    Args:
        models: Models by name.
        data: Transitions; those of one episode follow each other.
        longest: Longest horizon; shorter where no episode is as long.
        stride: Steps between the starts of two windows of one episode.

    Raises:
        InputError: `longest` is below 1, or a model does not fit the data.
    """
    if longest < 1:
        raise InputError(f"the longest horizon must be at least 1, got {longest!r}")
    horizons = _reached(data, range(1, longest + 1), stride)
    blend = window_errors(RigidBlend(), data, horizons, stride)
    return {
        name: _curve([window_errors(model, data, horizons, stride) for model in trained], horizons, blend)
        for name, trained in models.items()
    }


def _reached(data: Transitions, horizons: Iterable[int], stride: int) -> tuple[int, ...]:
    """Those horizons that some episode is long enough for."""
    return tuple(h for h in horizons if len(window_starts(data.episode, h, stride)))


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


def training_groups(cards: Mapping[str, Mapping[str, Any]]) -> dict[str, list[str]]:
    """Names of models that differ only in the seed they were trained with, under the first of them."""
    groups: dict[str, list[str]] = {}
    firsts: dict[str, str] = {}
    for name, card in cards.items():
        training = {key: value for key, value in card.get("training", {}).items() if key != "seed"}
        made = json.dumps([card.get("kind"), card.get("model"), training, card.get("data", {}).get("sha256")])
        groups.setdefault(firsts.setdefault(made, name), []).append(name)
    return groups


def _curve(trained: list[WindowErrors], horizons: tuple[int, ...], blend: WindowErrors | None = None) -> Curve:
    """The figures of all windows; with the errors of the rigid blend also those beside it, and all intervals."""
    stacked = 1e3 * np.concatenate([errors.stacked for errors in trained])
    distances = 1e3 * np.concatenate([errors.mean for errors in trained])
    above = np.zeros((0, 0)) if blend is None else stacked - 1e3 * np.tile(blend.stacked, (len(trained), 1))
    means = 1e3 * np.stack([np.nanmean(errors.stacked, axis=0) for errors in trained])
    per_episode = [_episode_means(trained, i) for i in range(len(horizons))]
    quartiles = np.array([np.percentile(values, [25, 75]) for values in per_episode])
    return Curve(
        horizons=horizons,
        median=_numbers(np.nanmedian(stacked, axis=0)),
        mean=_numbers(np.nanmean(stacked, axis=0)),
        p95=_numbers(np.nanpercentile(stacked, 95, axis=0)),
        worst=_numbers(np.nanmax(stacked, axis=0)),
        keypoint_mean=_numbers(np.nanmean(distances, axis=0)),
        above_blend=() if blend is None else _numbers(np.nanmean(above, axis=0)),
        intervals={} if blend is None else _intervals(trained, stacked, above),
        quartiles=(_numbers(quartiles[:, 0]), _numbers(quartiles[:, 1])),
        seeds=(_numbers(means.min(axis=0)), _numbers(means.max(axis=0))),
        windows=tuple(int(count) for count in np.isfinite(trained[0].stacked).sum(axis=0)),
        episodes=tuple(len(values) // len(trained) for values in per_episode),
        trainings=len(trained),
    )


def _episode_means(trained: list[WindowErrors], place: int) -> Float[np.ndarray, "e"]:
    """Mean stacked error [mm] of each episode and seed at one horizon."""
    means = []
    for errors in trained:
        known = np.isfinite(errors.stacked[:, place])
        episodes, index = np.unique(errors.episode[known], return_inverse=True)
        totals = np.bincount(index, errors.stacked[known, place], minlength=len(episodes))
        means.append(1e3 * totals / np.bincount(index))
    return np.concatenate(means)


def _intervals(
    trained: list[WindowErrors], stacked: Float[np.ndarray, "k H"], above: Float[np.ndarray, "k H"]
) -> dict[str, Ends]:
    """Intervals of the figures at each horizon, the same episodes resampled for all seeds."""
    names, episodes = ("mean", *SHARES, "above_blend"), np.concatenate([errors.episode for errors in trained])
    found: list[list[tuple[float | None, float | None]]] = []
    for errors, differences in zip(stacked.T, above.T, strict=True):
        known = np.isfinite(errors)
        among = episodes[known]
        if len(np.unique(among)) > 1:
            found.append(
                [
                    *intervals(errors[known], among, tuple(SHARES.values())),
                    *intervals(differences[known], among),
                ]
            )
        else:
            found.append([(None, None)] * len(names))
    ends = zip(*found, strict=True)
    return {name: tuple(zip(*each, strict=True)) for name, each in zip(names, ends, strict=True)}


def _numbers(values: Float[np.ndarray, "H"]) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
