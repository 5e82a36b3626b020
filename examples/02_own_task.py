"""A task made in Python: another cable, obstacles of each kind, ends given by gripper poses.

Two grippers do not fix the shape between them: a cable can bend to either side, and sometimes more. `shape_between`
finds the stable shape of lowest energy on the given side, as `bend:` does in a task file.
"""

from pathlib import Path

import numpy as np

import cableway as cw
from cableway.figures.plan import plan_figure
from cableway.figures.style import save_figure
from cableway.rod.inverse import Bend, shape_between

cable = cw.Cable(length=0.34, radius=0.0025)


def shape(left: tuple[float, float, float], right: tuple[float, float, float], bend: Bend) -> np.ndarray:
    """Keypoints of the cable between two gripper poses (x, y, theta)."""
    q = shape_between(cable.rod, np.array([left, right]), bend)
    return cable.rod.at_keypoints(cable.rod.shapes(q[None])[0])[0]


task = cw.Task(
    name="post-and-corner",
    scene=cw.Scene(
        size=(0.8, 0.6),
        obstacles=(
            cw.Disc(center=(0.36, 0.30), radius=0.05),
            cw.Box(center=(0.56, 0.13), size=(0.05, 0.20), angle=0.2),
            cw.Polygon(vertices=np.array([[0.50, 0.45], [0.62, 0.50], [0.50, 0.56]])),
        ),
    ),
    cable=cable,
    start=shape((0.08, 0.12, 0.6), (0.34, 0.10, -0.4), "left"),
    goal=shape((0.68, 0.14, 1.9), (0.66, 0.42, 1.3), "right"),
)
plan = cw.plan(task, seed=0)
print(f"{plan.steps} steps; {cw.verify_plan(plan, task)}")

# How long it takes is the grippers' affair: the plan keeps to their limits per control step of 0.1 s.
moves = np.linalg.norm(np.diff(plan.poses[:, :, :2], axis=0), axis=2)
print(f"largest gripper step {1000 * moves.max():.1f} mm of {1000 * task.grippers.max_step:.1f} mm allowed")

picture = Path("out/post-and-corner.png")
save_figure(plan_figure(task, plan), picture)
print("wrote", picture)
