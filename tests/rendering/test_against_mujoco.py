"""The rasteriser against MuJoCo's renderer, where the machine has the libraries that this needs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cableway.rendering.camera import Camera
from cableway.rendering.mesh import Mesh, capsules, prism
from cableway.rendering.picture import Light, render

SIZE = (320, 240)
EYE = Camera.looking(np.array([0.6, -0.8, 0.9]), np.array([-0.6, 0.8, -0.85]), size=SIZE, view=0.8)

BALL, BOX, CAPSULE = (
    ((0.15, 0.1, 0.1), 0.1),
    ((-0.25, 0.0, 0.08), (0.1, 0.06, 0.08)),
    ((0, -0.2, 0.05), (0.2, 0, 0.3), 0.04),
)

SCRIPT = """
import json, sys
import mujoco
import numpy as np
model = mujoco.MjModel.from_xml_string(sys.argv[1])
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
with mujoco.Renderer(model, *map(int, sys.argv[2:4])) as renderer:
    renderer.update_scene(data, "eye")
    renderer.enable_depth_rendering()
    depth = renderer.render().copy()
    renderer.disable_depth_rendering()
    renderer.enable_segmentation_rendering()
    np.savez(sys.argv[4], depth=depth, geom=renderer.render()[..., 0])
"""


def scene() -> str:
    """The same for MuJoCo, whose cameras look along -z with y upwards."""
    x, y = EYE.pose[:3, 0], -EYE.pose[:3, 1]
    (width, height), focal = SIZE, EYE.focal[1]
    view = np.degrees(2 * np.arctan(height / 2 / focal))

    def text(*numbers: object) -> str:
        return " ".join(map(str, np.concatenate([np.ravel(np.asarray(each, float)) for each in numbers])))

    return f"""<mujoco><visual><global offwidth="{width}" offheight="{height}"/><map znear="0.01" zfar="20"/></visual>
        <worldbody><camera name="eye" pos="{text(EYE.pose[:3, 3])}" xyaxes="{text(x, y)}" fovy="{view}"/>
        <geom type="box" pos="0 0 -0.05" size="1 1 0.05"/>
        <geom type="sphere" pos="{text(BALL[0])}" size="{BALL[1]}"/>
        <geom type="box" pos="{text(BOX[0])}" size="{text(BOX[1])}"/>
        <geom type="capsule" fromto="{text(*CAPSULE[:2])}" size="{CAPSULE[2]}"/>
        </worldbody></mujoco>"""


def by_mujoco(path: Path) -> dict[str, np.ndarray]:
    """Depths and geoms by MuJoCo, in a process of its own: what draws is chosen as it is loaded."""
    environment = {**os.environ, "MUJOCO_GL": "egl"}
    command = [sys.executable, "-c", SCRIPT, scene(), str(SIZE[1]), str(SIZE[0]), str(path)]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
    if run.returncode or not path.exists():
        pytest.skip(f"MuJoCo's renderer does not work here: {json.dumps(run.stderr[-200:])}")
    return dict(np.load(path))


def test_depths_and_what_is_seen_are_those_of_mujocos_renderer(tmp_path: Path):
    theirs = by_mujoco(tmp_path / "seen.npz")
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    (at, half), ((x, y, z), (a, b, c)) = BALL, BOX
    outline = np.array([[x - a, y - b], [x + a, y - b], [x + a, y + b], [x - a, y + b]])
    mesh = Mesh.joined(
        [
            prism(square, (-0.1, 0.0)).painted((1, 1, 1), 1),
            capsules(np.array([[at, at]], float), np.array([half])).painted((1, 0, 0), 2),
            prism(outline, (z - c, z + c)).painted((0, 1, 0), 3),
            capsules(np.array([CAPSULE[:2]], float), np.array([CAPSULE[2]])).painted((0, 0, 1), 4),
        ]
    )
    ours = render(mesh, EYE, Light(position=(0.5, -1.0, 3.0), shadows=0))
    same = ours.label == theirs["geom"] + 1  # none is -1 there
    assert same.mean() > 0.99, "but for edges"
    assert {1, 2, 3, 4} == set(np.unique(ours.label[same])) - {0}
    there = same & np.isfinite(ours.depth)
    off = np.abs(ours.depth - theirs["depth"])[there]
    assert np.median(off) < 2e-4
    assert np.percentile(off, 99) < 2e-3, "round surfaces have facets in both"
