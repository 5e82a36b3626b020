"""Transitions as a model is trained and judged on them: split by episode, cut into windows, mirrored and swapped."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from cableway.core.errors import InputError
from cableway.datasets.transitions import Transitions


class Windows(NamedTuple):
    """Stretches of H successive transitions: a start, H actions and the shape after each.

    Attributes:
        keypoints: (m, n, 2) [m] at the start.
        poses: (m, 2, 3) at the start [m, m, rad].
        actions: (m, H, 2, 3) [m, m, rad].
        targets: (m, H, n, 2) [m].
    """

    keypoints: Float[Array, "m n 2"]
    poses: Float[Array, "m 2 3"]
    actions: Float[Array, "m H 2 3"]
    targets: Float[Array, "m H n 2"]


FIELDS = ("keypoints", "poses", "actions", "next_keypoints", "episode")
"""Arrays with a row for each transition."""


def fingerprint(data: Transitions) -> str:
    """SHA-256 of a data set's arrays, in hexadecimal."""
    digest = hashlib.sha256()
    for name in FIELDS:
        array = np.ascontiguousarray(getattr(data, name), dtype="<f8")
        digest.update(f"{name}{array.shape}".encode() + array.tobytes())
    for name, values in sorted(data.cable.items()):
        digest.update(f"cable.{name}{values.shape}".encode() + np.ascontiguousarray(values, dtype="<f8").tobytes())
    return digest.hexdigest()


def select(data: Transitions, rows: Bool[np.ndarray, "m"] | Int[np.ndarray, "k"]) -> Transitions:
    """The given rows of a data set."""
    cable = {name: values[rows] for name, values in data.cable.items()}
    return Transitions(**{name: getattr(data, name)[rows] for name in FIELDS}, cable=cable, metadata=data.metadata)


def appended(sets: Sequence[Transitions]) -> Transitions:
    """The rows of several data sets, one after the other, without cables and metadata."""
    keypoints, poses, actions, after, episode = (
        np.concatenate([getattr(data, name) for data in sets]) for name in FIELDS
    )
    return Transitions(keypoints, poses, actions, after, episode)


def joined(sets: Sequence[Transitions]) -> Transitions:
    """One data set of several, one after the other; what their metadata say is kept as a list.

    Raises:
        InputError: They differ in the number of keypoints.
    """
    if len(sets) == 1:
        return sets[0]
    counts = sorted({data.keypoints.shape[1] for data in sets})
    if len(counts) > 1:
        raise InputError(f"data sets to join need the same number of keypoints, got {' and '.join(map(str, counts))}")
    episodes, first = [], 0
    for data in sets:
        numbers = np.unique(data.episode, return_inverse=True)[1]
        episodes.append(numbers + first)
        first += int(numbers.max()) + 1
    metadata = {"sets": [data.metadata for data in sets]}
    return replace(appended(sets), episode=np.concatenate(episodes), metadata=metadata)


def split_by_episode(data: Transitions, fraction: float, seed: int) -> tuple[Transitions, Transitions]:
    """Two parts that share no episode; the second has about `fraction` of the episodes, and at least one.

    Raises:
        InputError: There are fewer than two episodes.
    """
    episodes = np.unique(data.episode)
    if len(episodes) < 2:
        raise InputError(f"a data set to train on needs at least 2 episodes, got {len(episodes)}")
    count = min(max(1, round(fraction * len(episodes))), len(episodes) - 1)
    held = np.random.default_rng(seed).permutation(episodes)[:count]
    rows = np.isin(data.episode, held)
    return select(data, ~rows), select(data, rows)


def window_starts(episode: Int[np.ndarray, "m"], horizon: int, stride: int = 1) -> Int[np.ndarray, "k"]:
    """Rows at which `horizon` successive transitions of one episode begin, every `stride` rows of an episode."""
    rows = np.arange(len(episode))
    breaks = np.flatnonzero(np.diff(episode)) + 1
    begin = np.zeros(len(episode), int)
    begin[breaks] = breaks
    begin = np.maximum.accumulate(begin)
    end = np.append(breaks, len(episode))[np.searchsorted(breaks, rows, side="right")]
    return rows[(rows + horizon <= end) & ((rows - begin) % stride == 0)]


def windows(data: Transitions, starts: Int[np.ndarray, "k"], horizon: int) -> Windows:
    """The windows that begin at `starts`, in single precision."""
    steps = starts[:, None] + np.arange(horizon)
    parts = (data.keypoints[starts], data.poses[starts], data.actions[steps], data.next_keypoints[steps])
    return Windows(*(jnp.asarray(part, jnp.float32) for part in parts))


def mirrored(batch: Windows, flip: Bool[Array, "m"]) -> Windows:
    """The samples that `flip` marks, reflected at the x axis: y and all angles change sign."""
    sign = jnp.where(flip, -1.0, 1.0)
    point = jnp.stack([jnp.ones_like(sign), sign], axis=-1)
    pose = jnp.stack([jnp.ones_like(sign), sign, sign], axis=-1)
    return Windows(
        keypoints=batch.keypoints * point[:, None],
        poses=batch.poses * pose[:, None],
        actions=batch.actions * pose[:, None, None],
        targets=batch.targets * point[:, None, None],
    )


def swapped(batch: Windows, swap: Bool[Array, "m"]) -> Windows:
    """The samples that `swap` marks, read from the other end: keypoints and grippers reversed, tangents turned."""
    turned = batch.poses[:, ::-1] + jnp.array([[[0.0, 0.0, jnp.pi]]], dtype=jnp.float32)
    one, two = swap[:, None, None], swap[:, None, None, None]
    return Windows(
        keypoints=jnp.where(one, batch.keypoints[:, ::-1], batch.keypoints),
        poses=jnp.where(one, turned, batch.poses),
        actions=jnp.where(two, batch.actions[:, :, ::-1], batch.actions),
        targets=jnp.where(two, batch.targets[:, :, ::-1], batch.targets),
    )
