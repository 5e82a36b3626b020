"""The links of the chain: N + 1 of them, the first and last half as long, built outward from the middle one."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.rod.planar import PlanarRod


def link_lengths(rod: PlanarRod) -> Float[np.ndarray, "links"]:
    """Lengths [m] of the N + 1 links."""
    lengths = np.full(rod.hinges + 1, rod.length / rod.hinges)
    lengths[[0, -1]] /= 2
    return lengths


def middle_link(rod: PlanarRod) -> int:
    """Index of the link the chain is built from."""
    return rod.hinges // 2


def link_extents(rod: PlanarRod) -> Float[np.ndarray, "links"]:
    """Where each link ends [m] along its own axis from the joint that holds it: to the left is negative."""
    extents = link_lengths(rod)
    extents[: middle_link(rod)] *= -1
    return extents
