"""What cableway does when it finds no plan, and why it may find none where one exists.

The only route passes through a slit. The cable is 8 mm thick and the slit 14 mm wide, so the cable fits through it.
But a plan must keep 4 mm of clearance on either side, which takes 16 mm here, so there is none: the planner reports
what cannot pass and where, instead of returning a plan that scrapes along the wall. With 60 mm the same task is easy.
"""

import cableway as cw
from cableway.core.errors import PlanningError


def task(slit: float) -> cw.Task:
    """The cable has to move lengthwise through a wall with a slit of this width [m]."""
    width, thickness, height = 0.9, 0.03, 0.5
    leaf = (height - slit) / 2
    wall = tuple(cw.Box(center=(width / 2, y), size=(thickness, leaf)) for y in (leaf / 2, height - leaf / 2))
    line = [(x, height / 2) for x in (0.05 + 0.025 * i for i in range(13))]
    return cw.Task(
        name=f"slit-{1000 * slit:.0f}-mm",
        scene=cw.Scene(size=(width, height), obstacles=wall),
        cable=cw.Cable(length=0.3, radius=0.004),
        start=line,
        goal=[(x + 0.5, y) for x, y in line],
    )


for slit in (0.060, 0.014):
    try:
        plan = cw.plan(task(slit), seed=0)
    except PlanningError as error:
        print(f"slit of {1000 * slit:.0f} mm: {error}")
    else:
        print(f"slit of {1000 * slit:.0f} mm: a plan of {plan.steps} steps")
