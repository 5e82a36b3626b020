"""Several models on one data set: error against horizon, with its spread over episodes and over training seeds."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError
from cableway.records import Transitions
from cableway.tang2025.models.base import DeformationModel
from cableway.tang2025.models.dataset import window_starts
from cableway.tang2025.models.evaluation import WINDOW_STRIDE, WindowErrors, window_errors

LONGEST = 50
"""Steps predicted at most without looking."""


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
    quartiles: tuple[tuple[float, ...], tuple[float, ...]]
    seeds: tuple[tuple[float, ...], tuple[float, ...]]
    windows: tuple[int, ...]
    episodes: tuple[int, ...]
    trainings: int

    def at(self, horizon: int) -> dict[str, float]:
        """The figures at one horizon."""
        i = self.horizons.index(horizon)
        return {name: getattr(self, name)[i] for name in ("median", "mean", "p95", "worst", "keypoint_mean")}


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
    horizons = tuple(h for h in range(1, longest + 1) if len(window_starts(data.episode, h, stride)))
    return {
        name: _curve([window_errors(model, data, horizons, stride) for model in trained], horizons)
        for name, trained in models.items()
    }


def training_groups(cards: Mapping[str, Mapping[str, Any]]) -> dict[str, list[str]]:
    """Names of models that differ only in the seed they were trained with, under the first of them."""
    groups: dict[str, list[str]] = {}
    firsts: dict[str, str] = {}
    for name, card in cards.items():
        training = {key: value for key, value in card.get("training", {}).items() if key != "seed"}
        made = json.dumps([card.get("kind"), card.get("model"), training, card.get("data", {}).get("sha256")])
        groups.setdefault(firsts.setdefault(made, name), []).append(name)
    return groups


def _curve(trained: list[WindowErrors], horizons: tuple[int, ...]) -> Curve:
    stacked = 1e3 * np.concatenate([errors.stacked for errors in trained])
    distances = 1e3 * np.concatenate([errors.mean for errors in trained])
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


def _numbers(values: Float[np.ndarray, "H"]) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
