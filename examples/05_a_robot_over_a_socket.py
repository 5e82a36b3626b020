"""A plant in another process: both ends of a robot over a socket.

The protocol is one line of JSON per request, one per answer, over TCP, in metres and radians:

    {"do": "reset"}                                go to the start and observe
    {"do": "move", "action": [[x, y, t], ...]}     move both grippers by that much in one control step and observe

    {"time": 0.1, "keypoints": [[x, y] or null, ...], "poses": [[x, y, theta], ...]}    the observation
    {"error": "the left gripper does not move"}                                         why it failed

Here the server's robot is the simulator, with a camera that loses frames. In a lab, `Robot.reset` and `Robot.move`
talk to drivers instead and answer when the control step is over; `RobotPlant` can stay as it is. Both ends keep to the
limits: the loop sends nothing beyond them, and the robot does not rely on that.

The second run ends early: after forty requests the line is cut. The plant then raises `SimulationError`, as every plant
does that cannot go on, and the run ends with what was recorded so far.
"""

import json
import socket
import threading
from typing import Any

import numpy as np

import cableway as cw
from cableway.core.errors import SimulationError
from cableway.records import Measurement, Observation
from cableway.tracking import Plant

TASK = cw.load_task("single-obstacle-2")
TIMEOUT = 5.0
"""Time [s] without an answer after which the robot counts as lost."""


# ---------------------------------------------------------------- the robot's end
class Robot:
    """Answers requests; the part to be rewritten for real grippers and a real camera."""

    def __init__(self, hardware: Plant) -> None:
        self._hardware = hardware

    def answer(self, request: dict[str, Any]) -> dict[str, Any]:
        """What is sent back."""
        try:
            if request.get("do") == "reset":
                return self._told(self._hardware.reset())
            if request.get("do") == "move":
                return self._told(self._hardware.step(self._allowed(request.get("action"))))
            return {"error": f"do must be reset or move, got {request.get('do')!r}"}
        except (SimulationError, ValueError) as error:
            return {"error": str(error)}

    def _allowed(self, action: Any) -> np.ndarray:
        motion, limits = np.array(action, float), TASK.grippers
        if motion.shape != (2, 3) or not np.isfinite(motion).all():
            raise ValueError("action must be 2 x 3 finite numbers")
        if np.hypot(*motion[:, :2].T).max() > limits.max_step or np.abs(motion[:, 2]).max() > limits.max_turn:
            raise ValueError(f"action is beyond {limits.max_step} m or {limits.max_turn} rad")
        return motion

    @staticmethod
    def _told(seen: Observation) -> dict[str, Any]:
        keypoints = [None if np.isnan(point).any() else point.tolist() for point in seen.keypoints]
        return {"time": seen.time, "keypoints": keypoints, "poses": seen.poses.tolist()}


def serve(robot: Robot, listener: socket.socket, cut_after: int | None = None) -> None:
    """Answer one client until it goes; hang up after so many requests where that is wanted."""
    connection, _ = listener.accept()
    with connection, connection.makefile("rw") as lines:
        for count, line in enumerate(lines):
            if count == cut_after:
                return
            lines.write(json.dumps(robot.answer(json.loads(line))) + "\n")
            lines.flush()


# ---------------------------------------------------------------- our end
class RobotPlant:
    """The robot as the closed loop wants it."""

    control_step = 0.1

    def __init__(self, task: cw.Task, address: tuple[str, int]) -> None:
        self.task, self._address = task, address
        self._connection: socket.socket | None = None
        self._received = b""

    def reset(self) -> Observation:
        """Connect and go to the start."""
        self._known, self._poses = self.task.start, np.full((2, 3), np.nan)
        self.close()
        try:
            self._connection = socket.create_connection(self._address, TIMEOUT)
        except OSError as error:
            raise SimulationError(f"no robot at {self._name}: {error}") from None
        return self._seen(self._ask({"do": "reset"}))

    def step(self, action: np.ndarray) -> Observation:
        """Move and look."""
        return self._seen(self._ask({"do": "move", "action": action.tolist()}))

    def measure(self) -> Measurement:
        """What is known best, and the clearance of the straight lines between the keypoints."""
        task = self.task
        clearance = task.scene.clearance(self._known[None], task.cable.radius)[0]
        discs = task.scene.signed_distance(self._poses[:, :2]).min() - task.grippers.radius
        return Measurement(self._known, self._poses, self._known, float(clearance), float(discs))

    def close(self) -> None:
        """Hang up."""
        if self._connection is not None:
            self._connection.close()
        self._connection, self._received = None, b""

    @property
    def _name(self) -> str:
        return "{}:{}".format(*self._address)

    def _ask(self, request: dict[str, Any]) -> dict[str, Any]:
        """The answer to a request; whatever goes wrong on the line is a `SimulationError`."""
        assert self._connection is not None
        try:
            self._connection.sendall(json.dumps(request).encode() + b"\n")
            while b"\n" not in self._received:
                more = self._connection.recv(65536)
                if not more:
                    raise SimulationError(f"the robot at {self._name} hung up")
                self._received += more
            line, _, self._received = self._received.partition(b"\n")
            answer = json.loads(line)
        except TimeoutError:
            raise SimulationError(f"the robot at {self._name} did not answer within {TIMEOUT:g} s") from None
        except OSError as error:
            raise SimulationError(f"the connection to the robot at {self._name} is lost: {error}") from None
        except ValueError as error:
            raise SimulationError(f"the robot at {self._name} answered with what is no JSON: {error}") from None
        if "error" in answer:
            raise SimulationError(f"the robot at {self._name} refused: {answer['error']}")
        return answer

    def _seen(self, answer: dict[str, Any]) -> Observation:
        try:
            hidden = [np.nan, np.nan]
            keypoints = np.array([hidden if point is None else point for point in answer["keypoints"]], float)
            poses = np.array(answer["poses"], float)
            seen = Observation(float(answer["time"]), keypoints, poses)
            self._known = self._guess(keypoints, poses[:, :2])
        except (KeyError, TypeError, ValueError) as error:
            raise SimulationError(f"the robot at {self._name} answered with something else: {error!r}") from None
        self._poses = poses
        return seen

    def _guess(self, keypoints: np.ndarray, grippers: np.ndarray) -> np.ndarray:
        """Keypoints as seen; those that were not, carried along by the grippers, which hold the first and the last."""
        share = np.linspace(0.0, 1.0, len(keypoints))[:, None]
        motion = np.nan_to_num(grippers - self._poses[:, :2])
        known = np.where(np.isnan(keypoints), self._known + (1 - share) * motion[0] + share * motion[1], keypoints)
        known[[0, -1]] = grippers
        return known


# ---------------------------------------------------------------- both together
plan = cw.plan(TASK, seed=0)
for cut_after in (None, 40):
    camera = cw.SensingConfig(keypoint_noise=0.001, drop_rate=0.1)
    robot = Robot(cw.SensedPlant(cw.CableSimulator(TASK), camera, seed=0))
    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=serve, args=(robot, listener, cut_after), daemon=True).start()
        plant = RobotPlant(TASK, listener.getsockname())
        rollout = cw.track(plant, cw.RodMPC(), plan, watchdog=cw.Watchdog(deadline=0.1))
        plant.close()
    report = cw.summarize(TASK, plan, rollout)
    print(f"{rollout.steps} steps, {': '.join(filter(None, (rollout.outcome, rollout.detail)))}")
    if report.shape_error is not None:
        print(f"  {1000 * report.shape_error:.1f} mm from the goal, as far as the camera can tell")
