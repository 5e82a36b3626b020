"""The MuJoCo model of a cable in a scene, built in code.

The cable is the planar chain of `cableway.rod.planar`: N hinges at spacing L/N, N + 1 links of which the first
and last are half as long. Hinge stiffness is k = EI N/L and hinge damping tau k, so that the chain bends like a rod of
stiffness EI and creeps with time constant tau. The first link carries two slides and a hinge; both end links are
welded to bodies without dynamics, the grippers, whose poses are prescribed at every time step.

A hinge has the stiffness and the rest curvature of its place along the cable. Bent from rest by more than the yield
curvature it takes its rest angle along, at constant moment: perfect plasticity.

The plane is z = 0 with no gravity in it; `cableway.simulation.table` says what a table does to the cable. A capsule of
the cable's radius covers each link; capsules meet obstacles and walls, not each other. A disc is a sphere about z = 0
and a wall a half space, for which MuJoCo's contacts are exact; a box is a box and a polygon a convex mesh, both
reaching `HALF_HEIGHT` above and below.

Note:
    The paper (Tang et al.) simulates without contact between cable and obstacles.
"""

# MuJoCo's bindings are compiled and carry no type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import mujoco
import numpy as np

from cableway.scene.cable import PROFILES, Cable
from cableway.scene.scene import Scene
from cableway.simulation.links import link_extents, link_lengths, middle_link
from cableway.simulation.surroundings import add_free_gripper, add_scene, hold
from cableway.simulation.table import add_friction, viscosity

HALF_HEIGHT = 0.1
"""Half height of boxes and polygons [m]: far more than any penetration, so that no contact points out of the plane."""

GRASP_TIME_CONSTANT = 0.05
"""Time constant of the welds in time steps: as good as rigid, and stable under the `discrete` integrator."""

GRASP_IMPEDANCE = (0.99, 0.9999)
"""Least and greatest impedance of the welds."""

CONTACT_IMPEDANCE = (0.99, 0.999)
"""Least and greatest impedance of contacts, whose time constant is one time step."""

_IMPEDANCE_CURVE = (0.001, 0.5, 2.0)
"""Width [m], midpoint and power of the impedance curve, MuJoCo's defaults."""


def build_model(cable: Cable, scene: Scene | None, time_step: float) -> mujoco.MjModel:
    """Compile the model of a cable in a scene.

    Args:
        cable: The cable.
        scene: Workspace and obstacles, or None for open space without walls.
        time_step: [s].

    Returns:
        The model; of its bodies without dynamics the first is the left gripper, the second the right one.
    """
    model = chain_spec(cable, scene, time_step).compile()
    if cable.drag > 0:
        model.opt.viscosity = viscosity(model, cable.rod, cable.drag)
    return model


def chain_spec(cable: Cable, scene: Scene | None, time_step: float) -> mujoco.MjSpec:
    """What `build_model` compiles, without drag."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    _set_options(spec.option, time_step)
    _add_links(spec, cable, time_step)
    _add_grippers(spec, cable, time_step)
    if cable.friction > 0:
        add_friction(spec, cable, time_step)
    if scene is None:
        _drop_capsules(spec)
    else:
        heights, disc = [(-HALF_HEIGHT, HALF_HEIGHT)] * len(scene.obstacles), mujoco.mjtGeom.mjGEOM_SPHERE
        add_scene(spec, scene, heights, disc, contype=0, conaffinity=1, condim=1)
    return spec


def _set_options(option: mujoco.MjOption, time_step: float) -> None:
    option.timestep = time_step
    option.gravity = [0.0, 0.0, 0.0]
    option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.tolerance = 1e-10
    # the approximate diagonal makes the welds of a long chain soft: 18 mrad of slip instead of 0.01
    option.enableflags |= mujoco.mjtEnableBit.mjENBL_DIAGEXACT
    # a state out of bounds must be detected, not replaced by the initial one
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    # these only cost time: there is one chain, and Newton's method needs as many iterations from anywhere
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND | mujoco.mjtDisableBit.mjDSBL_WARMSTART


def _add_links(spec: mujoco.MjSpec, cable: Cable, time_step: float) -> None:
    extents, middle = link_extents(cable.rod), middle_link(cable.rod)
    root = spec.worldbody.add_body(name=f"link {middle}")
    for axis in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]):
        root.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    root.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 0.0, 1.0])
    _add_capsule(root, cable, float(extents[middle]), time_step)
    _add_arm(root, cable, range(middle + 1, len(extents)), float(extents[middle]), time_step)
    _add_arm(root, cable, range(middle - 1, -1, -1), 0.0, time_step)


def _add_arm(parent: mujoco.MjsBody, cable: Cable, links: range, offset: float, time_step: float) -> None:
    """Hang links on each other, the first at `offset` along `parent`, going right or left as their indices do."""
    extents = link_extents(cable.rod)
    for index in links:
        parent = parent.add_body(name=f"link {index}", pos=[offset, 0.0, 0.0])
        _add_hinge(parent, cable, min(index, index - links.step), links.step)
        offset = float(extents[index])
        _add_capsule(parent, cable, offset, time_step)


def _add_hinge(body: mujoco.MjsBody, cable: Cable, number: int, side: int) -> None:
    """Hold a body by hinge `number` (between links `number` and `number` + 1) on the right (1) or left (-1) arm."""
    hinges, share = cable.rod.hinges, cable.length / cable.rod.hinges
    position = np.array([(number + 0.5) / hinges])
    factor, curvature = (float(cable.along(name, position)[0]) for name in PROFILES)
    stiffness = cable.bending_stiffness * hinges / cable.length * factor
    hinge = body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 0.0, 1.0])
    hinge.stiffness[0] = stiffness
    hinge.damping[0] = cable.damping_time * stiffness
    hinge.springref = side * share * curvature
    hinge.springyield = share * cable.yield_curvature


def _add_capsule(body: mujoco.MjsBody, cable: Cable, extent: float, time_step: float) -> None:
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[0.0, 0.0, 0.0, extent, 0.0, 0.0],
        size=[cable.radius, 0.0, 0.0],
        mass=cable.linear_density * abs(extent),
        contype=1,
        conaffinity=0,
        condim=1,
        solref=[time_step, 1.0],
        solimp=[*CONTACT_IMPEDANCE, *_IMPEDANCE_CURVE],
        priority=1,
    )


def _drop_capsules(spec: mujoco.MjSpec) -> None:
    """Where nothing can be met: the compiler keeps the inertia of the links, MuJoCo need not move their capsules."""
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    spec.compiler.discardvisual = True
    for capsule in spec.geoms:
        capsule.contype = 0


def _add_grippers(spec: mujoco.MjSpec, cable: Cable, time_step: float) -> None:
    last, extent = cable.rod.hinges, float(link_lengths(cable.rod)[-1])
    for name, link, along in (("left", 0, -extent), ("right", last, extent)):
        stiff = {"solref": [GRASP_TIME_CONSTANT * time_step, 1.0], "solimp": [*GRASP_IMPEDANCE, *_IMPEDANCE_CURVE]}
        add_free_gripper(spec, name)
        hold(spec, name, f"link {link}", along, **stiff)
