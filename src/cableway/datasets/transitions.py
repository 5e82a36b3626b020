"""The record of transitions that models learn from."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.core.brief import Brief
from cableway.core.errors import InputError
from cableway.core.files import check_shapes


@dataclass(frozen=True, repr=False)
class Transitions(Brief):
    """Simulated or recorded transitions of one control step each; see `cableway.datasets` for those on disk.

    Attributes:
        keypoints: (m, n, 2) [m] before the step.
        poses: (m, 2, 3) gripper poses before the step.
        actions: (m, 2, 3) gripper motion of the step (dx, dy, dtheta).
        next_keypoints: (m, n, 2) [m] after the step.
        episode: (m,) number of the episode.
        cable: Fields of `scene.cable.Cable` that are not the same throughout: (m,), or (m, k) along the length.
        metadata: Seed, versions, cable and collection configuration.
    """

    keypoints: Float[np.ndarray, "m n 2"]
    poses: Float[np.ndarray, "m 2 3"]
    actions: Float[np.ndarray, "m 2 3"]
    next_keypoints: Float[np.ndarray, "m n 2"]
    episode: Float[np.ndarray, "m"]
    cable: dict[str, Float[np.ndarray, "m ..."]] = field(default_factory=dict)
    metadata: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_shapes(self)
        if not len(self.keypoints):
            raise InputError("a data set needs at least one transition")
        arrays = {name: getattr(self, name) for name in ("keypoints", "poses", "actions", "next_keypoints")}
        for name, array in {**arrays, **self.cable}.items():
            if len(array) != len(self.keypoints):
                raise InputError(f"{name} has {len(array)} rows, not {len(self.keypoints)}")
            if not np.isfinite(array).all():
                raise InputError(f"{name} holds a number that is not finite")

    def __len__(self) -> int:
        return len(self.keypoints)
