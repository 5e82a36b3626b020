"""Tasks to YAML files that `load_task` reads back."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from jaxtyping import Float

from cableway.core.files import write_text
from cableway.scene.files.cells import stated, stated_cell
from cableway.scene.files.document import Dumper
from cableway.scene.files.presets import preset_names
from cableway.scene.files.schema import FORMAT_VERSION
from cableway.scene.files.spatial import spatial_content
from cableway.scene.gripper_bodies import BodyPart
from cableway.scene.obstacles import Box, Disc, Obstacle
from cableway.scene.spatial.task import SpatialDraft
from cableway.scene.task import Draft


def save_task(task: Draft | SpatialDraft, path: str | os.PathLike[str]) -> None:
    """Write a task to a YAML file, atomically; `load_task` gives an equal task, to the last digit, or says why no cable
    can do what a draft says.

    Shapes are written as keypoints, with the gripper poses where the task states them; in space as twelve numbers. The
    cable's preset is left out where it is none of `preset_names()`; its values stand there in any case.
    """
    write_text(Path(path), task_text(task))


def task_text(task: Draft | SpatialDraft) -> str:
    """What `save_task` writes."""
    content = _content(task) if isinstance(task, Draft) else spatial_content(task)
    return yaml.dump(content, Dumper=Dumper, sort_keys=False, default_flow_style=None, allow_unicode=True, width=110)


def _content(task: Draft) -> dict[str, Any]:
    cable = task.cable.as_dict()
    if cable["preset"] not in preset_names():
        del cable["preset"]
    content: dict[str, Any] = {
        "cableway": FORMAT_VERSION,
        "name": task.name,
        "description": task.description,
        "workspace": stated({"size": list(task.scene.size), "wall_height": task.scene.wall_height}),
        "cable": cable,
        "grippers": stated(
            {**vars(task.grippers), "body": _gripper_body(task.grippers.body), "tilt": task.grippers.tilt or None}
        ),
        "obstacles": [_obstacle(obstacle) for obstacle in task.scene.obstacles],
        "start": _shape(task.start, task.start_poses),
        "goal": _shape(task.goal, task.goal_poses),
    }
    if task.plug is not None:
        content["plug"] = dict(vars(task.plug))
    if task.port is not None:
        content["port"] = {**vars(task.port), "position": list(task.port.position)}
    if task.cell is not None:
        content["cell"] = stated_cell(task.cell)
    return content


def _gripper_body(body: str | tuple[BodyPart, ...] | None) -> Any:
    if body is None or isinstance(body, str):
        return body
    return [{"outline": part.outline.tolist(), "heights": list(part.heights)} for part in body]


def _obstacle(obstacle: Obstacle) -> dict[str, Any]:
    if isinstance(obstacle, Box):
        kind, shape = "box", {"center": list(obstacle.center), "size": list(obstacle.size), "angle": obstacle.angle}
    elif isinstance(obstacle, Disc):
        kind, shape = "disc", {"center": list(obstacle.center), "radius": obstacle.radius}
    else:
        kind, shape = "polygon", {"vertices": obstacle.vertices.tolist()}
    return stated({"type": kind, **shape, "height": obstacle.height})


def _shape(keypoints: Float[np.ndarray, "n 2"] | None, poses: Float[np.ndarray, "2 3"] | None) -> Any:
    if keypoints is None:
        return None if poses is None else {"grippers": poses.tolist()}
    if poses is None:
        return keypoints.tolist()
    return {"grippers": poses.tolist(), "keypoints": keypoints.tolist()}
