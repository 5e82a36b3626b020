"""Colours, depth and labels of a cell as a camera sees it."""

import numpy as np

import cableway as cw
from cableway.figures.perspective import LOOK
from cableway.rendering.camera import Camera
from cableway.rendering.cell import CellScene, Label
from cableway.rendering.picture import Light, render

task = cw.random_task(0, "cell")
scene = CellScene(task, None, LOOK)  # or how the arms hold the cable, in place of None
mesh = scene.mesh(task.start, poses=task.gripper_poses("start"))  # or the joints of the arms
eye, middle = np.array([0.4, -0.6, 1.2]), np.array([0.4, 0.4, 0.0])
camera = Camera.looking(eye, middle - eye, size=(640, 480), view=0.9)
picture = render(mesh, camera, Light(position=(0.0, -0.5, 3.0)))
cable = picture.label == Label.CABLE
print(picture.color.shape, f"{picture.depth[cable].mean():.2f} m")
