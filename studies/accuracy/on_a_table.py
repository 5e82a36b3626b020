"""A cable that lies on a table by its weight, in three dimensions: the reference for friction in the plane.

Nothing of the plant's model is used. The links are as long as the plant's, but hang on each other by ball joints, from
the left end to the right one; each is a capsule that rests on a plane under gravity, at both of its ends, with
elliptic friction cones. So a link may lift off, tilt and twist; its friction acts where it touches, alike in all
directions. The grippers hold the ends at the height at which the cable rests.
"""

# MuJoCo's bindings are compiled and carry no type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float

from cableway.scene.cable import Cable
from cableway.scene.files.loading import cable_from_preset
from cableway.scene.task import CONTROL_STEP
from cableway.simulation.chain import Chain
from cableway.simulation.plant import PlantConfig
from cableway.simulation.random_motion import MotionConfig, random_motion
from cableway.simulation.table import GRAVITY

LENGTH = 0.3
"""[m]."""

CABLES = {
    **{name: cable_from_preset(name, length=LENGTH) for name in ("usb", "silicone", "cotton", "paracord")},
    "soft paracord": cable_from_preset("paracord", length=LENGTH).sample(3),
}
"""From one that friction hardly matters to, to one that lies where it was dragged."""

TIME_STEP = 0.002
"""Of the reference [s]."""

FRICTION_TO_NORMAL = 100.0
"""How much stiffer friction is than what carries the weight: what sticks creeps so much slower."""

MOVING, WAITING = 30, 10
"""Control steps of a motion and of the rest after it."""


def friction(seed: int, motions: int = 6) -> dict[str, Any]:
    """Random motions of `cableway collect` on the table, of the plant and of the reference.

    Returns:
        `cable`; `number` mu g rho L^3/EI; for each of them, [m]: `off` and `effect`, distances of the plant's
        keypoints to the reference's after every control step, with friction and without any, (motions, steps, n); and
        `lifted`, how far the reference's highest link was above where it rests.
    """
    found: dict[str, list[Any]] = {name: [] for name in ("cable", "number", "off", "effect", "lifted")}
    for name, cable in CABLES.items():
        rng = np.random.default_rng(seed)
        off, effect, lifted = zip(*(_run(cable, rng) for _ in range(motions)), strict=True)
        found["cable"].append(name)
        found["number"].append(
            cable.friction * GRAVITY * cable.linear_density * cable.length**3 / cable.bending_stiffness
        )
        found["off"].append(np.round(off, 9).tolist())
        found["effect"].append(np.round(effect, 9).tolist())
        found["lifted"].append(max(lifted))
    return found


def _run(cable: Cable, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, float]:
    q, poses = random_motion(cable.rod, MotionConfig(), MOVING, rng)
    poses = np.concatenate([poses, np.repeat(poses[-1:], WAITING, axis=0)])
    reference, lifted = spatial_keypoints(cable, q, poses)
    off, effect = (
        np.linalg.norm(planar_keypoints(each, q, poses) - reference, axis=-1)
        for each in (cable, replace(cable, friction=0.0))
    )
    return off, effect, lifted


def planar_keypoints(cable: Cable, q: Float[np.ndarray, "6"], poses: Float[np.ndarray, "k+1 2 3"]) -> np.ndarray:
    """Keypoints (k, n, 2) of the plant's chain after each control step."""
    chain = Chain(cable, None, PlantConfig.time_step)
    chain.place(q)
    rows = chain.advance(_between(poses, PlantConfig.time_step))[PlantConfig().substeps - 1 :: PlantConfig().substeps]
    return chain.keypoints(chain.polylines(rows))


def spatial_keypoints(
    cable: Cable, q: Float[np.ndarray, "6"], poses: Float[np.ndarray, "k+1 2 3"], time_step: float = TIME_STEP
) -> tuple[np.ndarray, float]:
    """Keypoints (k, n, 2) of the reference after each control step, and how far it lifted off [m]."""
    model = spatial_chain(cable, time_step)
    data = mujoco.MjData(model)
    _lay(data, cable, q)
    rows, highest, steps = [], 0.0, round(CONTROL_STEP / time_step)
    for count, held in enumerate(_between(poses, time_step), start=1):
        data.mocap_pos[:, :2], data.mocap_quat[:] = held[:, :2], _yaw(held[:, 2])
        mujoco.mj_step(model, data)
        highest = max(highest, float(data.geom_xpos[1:, 2].max()) - cable.radius)
        if count % steps == 0:
            mujoco.mj_kinematics(model, data)
            middles = data.geom_xpos[2:-1, :2]
            rows.append(np.concatenate([data.site_xpos[:1, :2], middles, data.site_xpos[1:, :2]]))
    return np.array(rows)[:, :: cable.rod.hinges // (cable.keypoints - 1)], highest


def spatial_chain(cable: Cable, time_step: float) -> mujoco.MjModel:
    """The reference's model."""
    spec = mujoco.MjSpec()
    spec.option.timestep = time_step
    spec.option.gravity = [0.0, 0.0, -GRAVITY]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = FRICTION_TO_NORMAL
    spec.option.enableflags |= mujoco.mjtEnableBit.mjENBL_DIAGEXACT
    plane, touch = mujoco.mjtGeom.mjGEOM_PLANE, {"condim": 3, "friction": [cable.friction, 0.0, 0.0]}
    spec.worldbody.add_geom(type=plane, size=[1.0, 1.0, 1.0], contype=0, conaffinity=1, **touch)
    whole = cable.length / cable.rod.hinges
    stiffness = cable.bending_stiffness / whole
    body, offset = spec.worldbody, 0.0
    for link in range(cable.rod.hinges + 1):
        length = whole if 0 < link < cable.rod.hinges else whole / 2
        body = body.add_body(name=f"link {link}", pos=[offset, 0.0, 0.0])
        if link:
            joint = body.add_joint(type=mujoco.mjtJoint.mjJNT_BALL)
            joint.stiffness[0], joint.damping[0] = stiffness, cable.damping_time * stiffness
        else:
            body.add_freejoint()
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[0.0, 0.0, 0.0, length, 0.0, 0.0], size=[cable.radius, 0.0, 0.0],
            mass=cable.linear_density * length, contype=1, conaffinity=0, solref=[2 * time_step, 1.0], **touch,
        )  # fmt: skip
        offset = length
    for name, end in (("link 0", 0.0), (f"link {cable.rod.hinges}", offset)):
        spec.body(name).add_site(pos=[end, 0.0, 0.0])
        gripper = spec.worldbody.add_body(name=f"gripper of {name}", mocap=True, pos=[0.0, 0.0, cable.radius])
        weld = spec.add_equality(
            type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY, name1=name, name2=gripper.name,
            solref=[0.05 * time_step, 1.0], solimp=[0.99, 0.9999, 0.001, 0.5, 2.0],
        )  # fmt: skip
        # anchor in the gripper, then position and quaternion of the gripper in the link, torque scale
        weld.data = [0.0, 0.0, 0.0, end, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    return spec.compile()


def _lay(data: mujoco.MjData, cable: Cable, q: Float[np.ndarray, "6"]) -> None:
    """Lay the reference flat into the equilibrium q."""
    stations, poses = cable.rod.shapes(q[None])
    links = np.diff(stations[0, 1::2], axis=0)
    angles = np.concatenate([poses[0, :1, 2], np.arctan2(links[:, 1], links[:, 0]), poses[0, 1:, 2]])
    data.qpos[:3] = *stations[0, 0], cable.radius
    data.qpos[3:7] = _yaw(angles[:1])[0]
    data.qpos[7:] = _yaw(np.diff(angles)).ravel()


def _between(poses: Float[np.ndarray, "k+1 2 3"], time_step: float) -> Float[np.ndarray, "s 2 3"]:
    """Gripper poses at the end of each time step, at constant speed from one control step to the next."""
    shares = np.arange(1, round(CONTROL_STEP / time_step) + 1)[:, None, None] * time_step / CONTROL_STEP
    return (poses[:-1, None] + shares * np.diff(poses, axis=0)[:, None]).reshape(-1, 2, 3)


def _yaw(angles: Float[np.ndarray, "k"]) -> Float[np.ndarray, "k 4"]:
    zero = np.zeros_like(angles)
    return np.column_stack([np.cos(angles / 2), zero, zero, np.sin(angles / 2)])
