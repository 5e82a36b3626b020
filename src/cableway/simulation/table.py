"""What a table does to a cable that lies on it: Coulomb friction under its weight, and linear drag.

Both act on the middle of each link, in the plane. The cable lies flat along its whole length: nothing lifts it.

A link of mass m that slides loses mu m g to friction. Friction is made of lines, one in each of `DIRECTIONS`, along
which a link moves against a constant resistance f: motion in direction d meets f sum_i |d . e_i|, which with
f = mu m g pi / (2 `DIRECTIONS`) is mu m g on average over all directions, and from 5% less to 3% more in each. A line
is a tendon from the link to a point so far away that its direction is the same all over the workspace.

Drag is that of MuJoCo's viscous medium: 3 pi eta b v on a link of speed v, b the mean width of the box of its inertia.
The half links at the ends, whose boxes are smaller, are moved by the grippers whatever resists them.

Note:
    A chain in space whose links rest on a plane by their weight, with MuJoCo's elliptic friction cones, is the obvious
    model; it has three times the freedoms and is several times slower. `docs/simulator.md` compares the two.
"""

# MuJoCo's bindings are compiled and carry no type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math

import mujoco
import numpy as np

from cableway.rod.material import GRAVITY
from cableway.rod.planar import PlanarRod
from cableway.scene.cable import Cable
from cableway.simulation.links import link_extents

DIRECTIONS = 4
"""Directions of the lines, evenly spread over half a turn."""

FAR = 1000.0
"""Distance [m] of the points that lines lead to: a workspace of 1 m turns them by 1 mrad."""

FRICTION_IMPEDANCE = (0.999, 0.9999)
"""Least and greatest impedance of friction: a link held by it creeps by less than 1 um/s."""


def add_friction(spec: mujoco.MjSpec, cable: Cable, time_step: float) -> None:
    """Let every link of the chain rub on the table."""
    for i, angle in enumerate(np.arange(DIRECTIONS) * np.pi / DIRECTIONS):
        spec.worldbody.add_site(name=f"far {i}", pos=[FAR * math.cos(angle), FAR * math.sin(angle), 0.0])
    for index, extent in enumerate(link_extents(cable.rod)):
        spec.body(f"link {index}").add_site(name=f"middle {index}", pos=[extent / 2, 0.0, 0.0])
        weight = GRAVITY * cable.linear_density * abs(extent)
        for i in range(DIRECTIONS):
            line = spec.add_tendon(name=f"line {index} {i}")
            line.wrap_site(f"middle {index}")
            line.wrap_site(f"far {i}")
            line.frictionloss = cable.friction * weight * math.pi / (2 * DIRECTIONS)
            line.solref_friction = [time_step, 1.0]
            line.solimp_friction[:2] = FRICTION_IMPEDANCE


def viscosity(model: mujoco.MjModel, rod: PlanarRod, drag: float) -> float:
    """The viscosity eta [Pa s] at which an inner link meets `drag` [N s/m^2] times its length."""
    link = model.body("link 1").id
    inertia, mass = model.body_inertia[link], model.body_mass[link]
    widths = np.sqrt(6 * (inertia.sum() - 2 * inertia) / mass)
    return drag * rod.length / rod.hinges / (3 * math.pi * float(widths.mean()))
