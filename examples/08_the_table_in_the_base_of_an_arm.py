"""The frame of the table in the base of an arm, from three points that its tool has touched.

O is the lower left corner of the workspace, X a point on its lower edge, Y one on its left edge.
"""

import numpy as np

touched = np.array([[0.3120, -0.2040, 0.0150], [0.3155, 0.4959, 0.0162], [-0.3878, -0.2006, 0.0171]])  # O, X, Y [m]
x = touched[1] - touched[0]
z = np.cross(x, touched[2] - touched[0])
axes = np.stack([x / np.linalg.norm(x), np.cross(z, x) / np.linalg.norm(np.cross(z, x)), z / np.linalg.norm(z)], 1)
place = (touched - touched[0]) @ axes  # where the three are in the task's frame
print("table in base, axes as columns:", *axes.round(4).tolist(), sep="\n")
print("X and Y are", *np.linalg.norm(touched[1:] - touched[0], axis=1).round(4), "m from O")
print("the edges are", np.degrees(np.arctan2(place[2, 1], place[2, 0])).round(2), "degrees apart")
