"""What the cameras of a run see: pictures of one row of it, with the keypoints that were found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, UInt8

from cableway.figures import palette
from cableway.perception.calibration import CalibratedCamera
from cableway.scene.cell import Way
from cableway.scene.scene import Scene
from cableway.scene.task import Task
from cableway.studio.running import Running
from cableway.tracking import Row
from cableway.tracking.photographer import Photographer, State

SIZE = (320, 240)
"""Width and height [pixels]: half of what the run is followed by."""

DOT = 1
"""Pixels to each side of a keypoint that are coloured."""

GREEN = palette.rgb(palette.GREEN)


class Pictures:
    """Makes the pictures of a run on the table that has cameras."""

    def __init__(self, running: Running) -> None:
        task, record, scene = running.task, running.rollout or running.plan, running.scene
        assert isinstance(task, Task)
        assert isinstance(scene, Scene)
        assert running.eyes is not None
        config = replace(running.eyes, picture=SIZE, depth=False)
        self._way = None if task.cell is None or record is None else Way.of_record(record.metadata)
        self._photographer = Photographer(task, self._way, config, scene)
        self._height = task.cable.radius

    def of(self, row: Row) -> UInt8[np.ndarray, "h w 3"]:
        """The pictures of a row, one below the other in the order of the cameras; green where keypoints were found."""
        measured, photographer = row.measured, self._photographer
        joints = None if self._way is None else measured.joints
        state = State(row.time, measured.centreline, measured.poses, joints)
        pictures = photographer.pictures(state, np.random.default_rng(0))
        found = row.observed[np.isfinite(row.observed).all(axis=1)]
        places = np.column_stack([found, np.full(len(found), self._height)])
        for picture, camera in zip(pictures, photographer.cameras, strict=True):
            _mark(picture, camera, places)
        return np.vstack(pictures)


def _mark(picture: UInt8[np.ndarray, "h w 3"], camera: CalibratedCamera, places: Float[np.ndarray, "k 3"]) -> None:
    """Colour the pixels about places [m]."""
    height, width = picture.shape[:2]
    for u, v in np.nan_to_num(camera.project(places)[0], nan=-1.0).round().astype(int).tolist():
        if 0 <= u < width and 0 <= v < height:
            picture[max(v - DOT, 0) : v + DOT + 1, max(u - DOT, 0) : u + DOT + 1] = GREEN
