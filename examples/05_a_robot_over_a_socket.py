"""A robot in another process, led in real time: both ends of a socket.

The protocol is one line of JSON per message over TCP, in metres and radians:

    {"do": "send", "poses": [[x, y, theta], ...]}  both grippers go there; 50 times a second, without an answer
    {"do": "observe"}                              what is known, answered at once:
    {"time": 0.1, "keypoints": [[x, y] or null, ...], "poses": [[x, y, theta], ...]}    the observation
    {"error": "the left gripper does not move"}                                         or why there is none
    {"do": "stop"}                                 come to rest and stay

Here the server moves the simulated cable, seen by a camera that loses frames. In a lab, `Server` talks to drivers
instead; `SocketRobot` can stay as it is. Both ends keep to the limits: the run sends nothing beyond them, and the robot
does not rely on that. It also has a time-out: without a command for 0.2 s it comes to rest.

The second run ends early: after 300 messages the line is cut. The driver then raises, as every driver does that cannot
go on, and the run ends with what was recorded so far.
"""

import contextlib
import json
import socket
import threading
import time
from typing import Any

import numpy as np

import cableway as cw
from cableway.records import Observation
from cableway.tracking import Plant

TASK = cw.load_task("single-obstacle-2")
SILENCE = 0.2
"""Time [s] without a command after which the robot comes to rest by itself."""

TIMEOUT = 0.5
"""Time [s] without an answer after which the robot counts as lost."""


# ---------------------------------------------------------------- the robot's end
class Server:
    """Takes commands; the part to be rewritten for real grippers and a real camera."""

    def __init__(self, hardware: Plant) -> None:
        self._hardware, self._last, self._stopped = hardware, time.monotonic(), False
        self._seen = hardware.reset()
        self._reached = self._target = self._seen.poses
        self.over = threading.Event()

    def work(self) -> None:
        """Move the hardware to what was sent last, ten times a second, until it is over; runs in a thread."""
        due = time.monotonic()
        while not self.over.is_set():
            silent = self._stopped or time.monotonic() - self._last > SILENCE
            step = np.zeros((2, 3)) if silent else self._allowed(self._target - self._reached)
            self._seen, self._reached = self._hardware.step(step), self._reached + step
            due += self._hardware.control_step
            self.over.wait(max(0.0, due - time.monotonic()))

    def serve(self, listener: socket.socket, cut_after: int | None = None) -> None:
        """Answer one client until it goes; hang up after so many messages where that is wanted."""
        connection, _ = listener.accept()
        with connection, connection.makefile("rw") as lines:
            for count, line in enumerate(lines):
                if count == cut_after:
                    return
                answer = self._answer(json.loads(line))
                if answer is not None:
                    lines.write(json.dumps(answer) + "\n")
                    lines.flush()

    def _answer(self, message: dict[str, Any]) -> dict[str, Any] | None:
        match message.get("do"):
            case "send" if not self._stopped:
                self._target, self._last = np.array(message["poses"], float).reshape(2, 3), time.monotonic()
            case "stop":
                self._stopped = True
            case "observe":
                seen = self._seen
                keypoints = [None if np.isnan(point).any() else point.tolist() for point in seen.keypoints]
                return {"time": seen.time, "keypoints": keypoints, "poses": seen.poses.tolist()}
        return None

    @staticmethod
    def _allowed(motion: np.ndarray) -> np.ndarray:
        limits = TASK.grippers
        far = np.linalg.norm(motion[:, :2], axis=1, keepdims=True)
        moves = motion[:, :2] * np.minimum(1.0, limits.max_step / np.maximum(far, 1e-9))
        return np.column_stack([moves, np.clip(motion[:, 2], -limits.max_turn, limits.max_turn)])


# ---------------------------------------------------------------- our end
class SocketRobot:
    """The robot as `track_in_real_time` wants it; whatever goes wrong on the line raises, and ends the run."""

    def __init__(self, task: cw.Task, address: tuple[str, int]) -> None:
        self.task = task
        self._connection = socket.create_connection(address, TIMEOUT)
        self._connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._lines = self._connection.makefile("r")

    def send(self, poses: np.ndarray) -> None:
        """Make poses the target."""
        self._tell({"do": "send", "poses": poses.tolist()})

    def observe(self) -> Observation:
        """Ask what is known."""
        self._tell({"do": "observe"})
        line = self._lines.readline()
        if not line:
            raise ConnectionError("the robot hung up")
        answer = json.loads(line)
        if "error" in answer:
            raise ConnectionError(f"the robot refused: {answer['error']}")
        hidden = [np.nan, np.nan]
        keypoints = np.array([hidden if point is None else point for point in answer["keypoints"]], float)
        return Observation(float(answer["time"]), keypoints, np.array(answer["poses"], float))

    def stop(self) -> None:
        """Come to rest; a robot that has hung up does so by itself."""
        with contextlib.suppress(OSError):
            self._tell({"do": "stop"})

    def close(self) -> None:
        """Hang up."""
        self._lines.close()
        self._connection.close()

    def _tell(self, message: dict[str, Any]) -> None:
        self._connection.sendall(json.dumps(message).encode() + b"\n")


# ---------------------------------------------------------------- both together
plan = cw.plan(TASK, seed=0)
for cut_after in (None, 300):
    camera = cw.SensingConfig(keypoint_noise=0.001, drop_rate=0.1)
    server = Server(cw.SensedPlant(cw.CableSimulator(TASK), camera, seed=0))
    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=server.work).start()
        threading.Thread(target=server.serve, args=(listener, cut_after), daemon=True).start()
        robot = SocketRobot(TASK, listener.getsockname())
        try:
            rollout = cw.track_in_real_time(robot, cw.RodMPC(), plan, rate=50, deadline=0.05)
        finally:
            robot.close()
            server.over.set()
    report = cw.summarize(TASK, plan, rollout)
    print(f"{rollout.steps} steps, {', '.join(filter(None, (rollout.outcome, rollout.detail)))}")
    if report.shape_error is not None and report.timing is not None:
        print(f"  {1000 * report.shape_error:.1f} mm from the goal, as far as the camera can tell;", end=" ")
        print(f"{report.timing['commands']} commands at {report.timing['rate']:g} Hz, {report.timing['late']} late")
