"""The closed loop: what it records, when it ends, and that controllers do what they are for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from quasi_static import START, QuasiStaticPlant, stacked, straight_plan, task_for

from cableway.control.base import Status
from cableway.control.open_loop import OpenLoop, OpenLoopConfig
from cableway.control.rod_mpc import RodMPC
from cableway.core.errors import InputError, PlanningError, SimulationError
from cableway.geometry import polyline
from cableway.planning.planner import plan
from cableway.records import Measurement, Observation, Plan, Rollout
from cableway.rod.inverse import equilibria_at, shape_between
from cableway.rod.planar import PlanarRod
from cableway.scene.obstacles import Disc
from cableway.scene.task import Task
from cableway.simulation.perturbations.sensing import SensedPlant, SensingConfig
from cableway.simulation.plant import CableSimulator, PlantConfig
from cableway.tang2025.control.mpc_config import MPCConfig
from cableway.tang2025.control.neural_mpc import NeuralMPC
from cableway.tang2025.models.base import RigidBlend
from cableway.tracking import BLOCKED, LOST, Recovery, TrackConfig, track
from cableway.tracking.recovery import Watch

ROD = PlanarRod(0.3)
PLAN = straight_plan(ROD, steps=40)
TASK = task_for(PLAN)
SHIFTED = START + np.array([0.006, -0.004, 0.06, 0.0, 0.0, 0.0])
"""A start that lies 7 mm and 3.4 degrees beside the planned one."""

EAGER = OpenLoop(OpenLoopConfig(hold=0.0))


def plant(q: np.ndarray = START, **settings: float) -> QuasiStaticPlant:
    return QuasiStaticPlant(TASK, q, ROD, **settings)  # pyright: ignore[reportArgumentType]


@pytest.fixture(scope="module")
def mpc() -> NeuralMPC:
    return NeuralMPC(RigidBlend(), MPCConfig(hold=0.5))


@pytest.fixture(scope="module")
def shifted(mpc: NeuralMPC) -> Rollout:
    return track(plant(SHIFTED), mpc, PLAN)


def largest_deviation(rollout: Rollout, since: int = 0) -> float:
    return float(np.linalg.norm(rollout.keypoints - rollout.reference, axis=-1)[since:].max())


def test_open_loop_follows_a_true_plan() -> None:
    rollout = track(plant(), OpenLoop(), PLAN)
    assert largest_deviation(rollout) < 1e-6
    assert rollout.metadata["outcome"] == "settled"


def test_open_loop_keeps_an_initial_offset_that_control_removes(shifted: Rollout) -> None:
    before = stacked(shifted.keypoints[0], PLAN.shapes[0])
    opened = track(plant(SHIFTED), EAGER, PLAN)
    assert before > 0.02
    assert stacked(opened.keypoints[-1], TASK.goal) > 0.7 * before
    assert stacked(shifted.keypoints[-1], TASK.goal) < 0.005
    assert largest_deviation(shifted, since=25) < 0.006


def test_in_the_simulator_control_removes_an_initial_offset(mpc: NeuralMPC) -> None:
    """The simulated cable starts beside the first row of the plan, and ends within 5 mm of its last."""
    moved = replace(TASK, start=ROD.at_keypoints(ROD.shapes(SHIFTED[None])[0])[0])
    rollout = track(CableSimulator(moved), mpc, PLAN)
    assert stacked(rollout.keypoints[0], PLAN.shapes[0]) > 0.02
    assert stacked(rollout.keypoints[-1], TASK.goal) < 0.005
    assert rollout.clearance.min() > 0
    assert rollout.metadata["outcome"] == "settled"


def test_in_the_simulator_open_loop_stays_within_millimetres() -> None:
    rollout = track(CableSimulator(TASK), EAGER, PLAN)
    assert largest_deviation(rollout) < 0.003


def test_with_noise_lost_frames_and_delay_control_still_arrives(mpc: NeuralMPC) -> None:
    """Seen through 2 mm of noise, 0.1 s late, one frame in five missing: stacked noise alone is 10 mm."""
    config = SensingConfig(keypoint_noise=0.002, drop_rate=0.2, measurement_delay=0.1)
    rollout = track(SensedPlant(CableSimulator(TASK), config, seed=1), mpc, PLAN)
    blind = np.isnan(rollout.observed[:-1]).all(axis=(1, 2))
    assert 0 < blind.sum() < len(blind) / 2
    assert [status == Status.UNSEEN for status in rollout.status.tolist()] == blind.tolist()
    assert stacked(rollout.keypoints[-1], TASK.goal) < 0.015
    assert largest_deviation(rollout) < 0.02
    assert rollout.metadata["outcome"] == "settled"


def test_a_controller_and_a_plant_of_other_control_steps_are_not_put_together(mpc: NeuralMPC) -> None:
    with pytest.raises(InputError, match=r"every 0\.1 s, but the plant every 0\.05 s"):
        track(CableSimulator(TASK, PlantConfig(control_step=0.05)), mpc, PLAN)


def test_what_is_sent_is_what_happens_and_never_exceeds_the_limits(shifted: Rollout) -> None:
    moves = np.linalg.norm(shifted.actions[..., :2], axis=-1)
    assert moves.max() <= TASK.grippers.max_step
    assert np.abs(shifted.actions[..., 2]).max() <= TASK.grippers.max_turn
    np.testing.assert_allclose(np.diff(shifted.poses, axis=0), shifted.actions, atol=1e-12)


def test_the_record_is_complete(shifted: Rollout, tmp_path: Path) -> None:
    np.testing.assert_allclose(shifted.times, 0.1 * np.arange(shifted.steps + 1))
    np.testing.assert_array_equal(shifted.reference[5], PLAN.shapes[0])
    np.testing.assert_array_equal(shifted.reference[15], PLAN.shapes[10])
    np.testing.assert_array_equal(shifted.reference[-1], PLAN.shapes[-1])
    np.testing.assert_array_equal(shifted.observed, shifted.keypoints)
    assert (shifted.solve_time > 0).all()
    assert set(shifted.status.tolist()) == {"tracking"}
    assert shifted.metadata["controller"]["name"] == "NeuralMPC"
    assert shifted.metadata["controller"]["config"]["horizon"] == 5
    shifted.save(tmp_path / "rollout.npz")
    assert Rollout.load(tmp_path / "rollout.npz").metadata == shifted.metadata


def test_the_least_clearance_is_of_cable_and_grippers(shifted: Rollout) -> None:
    for near, far in (("clearance", "gripper_clearance"), ("gripper_clearance", "clearance")):
        rows = {far: np.full(len(shifted.times), 0.02), near: np.linspace(0.03, 0.01, len(shifted.times))}
        assert replace(shifted, **rows).least_clearance == pytest.approx(0.01)


def test_the_same_run_twice_is_the_same(mpc: NeuralMPC, shifted: Rollout) -> None:
    again = track(plant(SHIFTED), mpc, PLAN)
    np.testing.assert_array_equal(again.actions, shifted.actions)
    np.testing.assert_array_equal(again.keypoints, shifted.keypoints)


@pytest.mark.parametrize("fails_after", [0, 1, 12])
def test_a_plant_that_fails_leaves_the_rollout_so_far(fails_after: int) -> None:
    rollout = track(plant(fails_after=fails_after), EAGER, PLAN)
    assert rollout.steps == fails_after
    assert (rollout.outcome, rollout.detail) == ("plant failed", "the chain came apart")
    assert [status for status in rollout.status.tolist() if "failed" in status] == (
        ["tracking; then the plant failed"] if fails_after else []
    )


def test_a_plant_that_reports_nonsense_has_failed() -> None:
    class Nonsense(QuasiStaticPlant):
        def measure(self) -> Measurement:
            measured = super().measure()
            return replace(measured, keypoints=measured.keypoints * (np.nan if self._step > 3 else 1.0))

    rollout = track(Nonsense(TASK, START, ROD), EAGER, PLAN)
    assert rollout.steps == 3
    assert rollout.outcome == "plant failed"
    assert rollout.detail == "the plant's measure reported keypoints that are not finite, or beyond 1e+06"


def test_a_plant_that_cannot_start_is_an_error() -> None:
    class Stuck(QuasiStaticPlant):
        def reset(self) -> Observation:
            raise SimulationError("no cable")

    with pytest.raises(SimulationError, match="no cable"):
        track(Stuck(TASK, START, ROD), EAGER, PLAN)


def test_it_ends_at_once_where_the_error_is_small() -> None:
    assert track(plant(), EAGER, PLAN).steps == PLAN.steps


def test_it_goes_on_while_the_error_falls() -> None:
    """A cable that lags: half of what is left in each step."""
    lagging = plant(lag=0.5)
    rollout = track(lagging, EAGER, PLAN, config=TrackConfig(small_error=1e-6))
    errors = np.linalg.norm(rollout.keypoints - TASK.goal, axis=(1, 2))
    assert rollout.steps > PLAN.steps + 5
    assert errors[-1] < 1e-6 < errors[PLAN.steps]
    patient = track(lagging, EAGER, PLAN, config=TrackConfig(small_error=0.0, settle_time=0.8, improvement=0.0))
    assert patient.steps == PLAN.steps + 8


def test_it_ends_where_the_error_no_longer_falls() -> None:
    rollout = track(plant(SHIFTED), EAGER, PLAN, config=TrackConfig(patience=0.5))
    assert rollout.steps == PLAN.steps + 5
    assert rollout.metadata["outcome"] == "settled"


def test_a_controller_that_sees_nothing_stops_and_time_runs_out(mpc: NeuralMPC) -> None:
    class Dark(QuasiStaticPlant):
        def step(self, action: np.ndarray) -> Observation:
            observation = super().step(action)
            hidden = np.full_like(observation.keypoints, np.nan)
            return replace(observation, keypoints=hidden) if self._step > 1 else observation

    rollout = track(Dark(TASK, START, ROD), mpc, PLAN, config=TrackConfig(overtime=1.0))
    assert rollout.metadata["outcome"] == "timed out"
    assert rollout.steps == PLAN.steps + 10
    assert rollout.status[-1] == "unseen: stopped"
    np.testing.assert_array_equal(rollout.actions[-1], 0.0)
    assert np.isnan(rollout.observed[-1]).all()


def test_progress_rises_to_1() -> None:
    reported: list[tuple[str, float]] = []
    note: Callable[[str, float], None] = lambda stage, share: reported.append((stage, share))  # noqa: E731
    track(plant(), EAGER, PLAN, progress=note)
    shares = [share for _, share in reported]
    assert {stage for stage, _ in reported} == {"track"}
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert max(shares[:-1]) < 1.0


def test_settings_out_of_range_are_refused() -> None:
    with pytest.raises(InputError, match="patience must be finite and not negative, got nan"):
        TrackConfig(patience=float("nan"))


ARC = shape_between(ROD, np.array([[0.2, 0.3, 0.0], [0.42, 0.3, 0.0]]), "left")
CARRIED = straight_plan(ROD, ARC, ARC + [0.08, 0.05, 0.0, 0.0, 0.0, 0.0], steps=40)
"""An arc carried aside; between the same grippers its mirror image is as stable."""
CARRIED_TASK = task_for(CARRIED)


class Snapping(QuasiStaticPlant):
    """At some steps the cable jumps to another shape that its grippers allow."""

    snaps: tuple[int, ...] = (15,)

    def step(self, action: np.ndarray) -> Observation:
        observation = super().step(action)
        if self._step not in self.snaps:
            return observation
        shapes = equilibria_at(self.rod, self._poses)
        stations = self.rod.shapes(shapes)[0]
        farthest = int(np.argmax(np.linalg.norm(stations - self._stations, axis=(1, 2))))
        self._now, self._stations = shapes[farthest], stations[farthest]
        return self._observe()


def planned_back(task: Task, left: Plan) -> Plan:
    return plan(task, previous=left)


def test_a_cable_that_snaps_is_stopped_within_half_a_second_and_led_on_by_a_new_plan() -> None:
    recovery = Recovery(replan=planned_back, rest=0.5)
    rollout = track(Snapping(CARRIED_TASK, ARC, ROD), EAGER, CARRIED, recovery=recovery)
    lost = [step for step, status in enumerate(rollout.status.tolist()) if status == LOST]
    assert 15 < lost[0] <= 15 + 5
    assert lost == list(range(lost[0], lost[0] + 2 + 5)), "a look, and half a second of rest"
    np.testing.assert_array_equal(rollout.actions[lost], 0.0)
    assert rollout.metadata["recovered"] == [pytest.approx(0.1 * (lost[-1] + 1))]
    assert rollout.metadata["outcome"] == "settled"
    assert stacked(rollout.keypoints[-1], CARRIED_TASK.goal) < 1e-3
    without = track(Snapping(CARRIED_TASK, ARC, ROD), EAGER, CARRIED)
    assert stacked(without.keypoints[-1], CARRIED_TASK.goal) > 0.03


def test_a_cable_that_snaps_again_and_again_is_given_up() -> None:
    plant = Snapping(CARRIED_TASK, ARC, ROD)
    plant.snaps = (15, 30)
    rollout = track(plant, EAGER, CARRIED, recovery=Recovery(replan=planned_back, times=1))
    assert (rollout.outcome, rollout.detail) == ("left plan", "already replanned 1 times")
    assert len(rollout.metadata["recovered"]) == 1


def test_a_cable_that_cannot_be_brought_back_is_a_clean_failure() -> None:
    def nowhere(task: Task, left: Plan) -> Plan:
        raise PlanningError("there is no plan")

    rollout = track(Snapping(CARRIED_TASK, ARC, ROD), EAGER, CARRIED, recovery=Recovery(replan=nowhere))
    assert (rollout.outcome, rollout.detail) == ("left plan", "there is no plan")
    assert not rollout.metadata["recovered"]
    np.testing.assert_array_equal(rollout.actions[-1], 0.0)


def test_on_its_plan_nothing_is_recovered(mpc: NeuralMPC, shifted: Rollout) -> None:
    again = track(plant(SHIFTED), mpc, PLAN, recovery=Recovery(replan=planned_back))
    np.testing.assert_array_equal(again.actions, shifted.actions)


def test_settings_of_recovery_are_checked() -> None:
    with pytest.raises(InputError, match="deviation must be finite"):
        Recovery(replan=planned_back, deviation=np.nan)


BLOCKED_TASK = replace(
    CARRIED_TASK, scene=replace(CARRIED_TASK.scene, obstacles=(Disc(center=(0.41, 0.37), radius=0.01),))
)
"""A disc over which the plan carries the right leg of the arc; there is a way round."""


class Uncovered(SensedPlant):
    """What stands there is known only from some time on."""

    def __init__(self, known_from: float) -> None:
        super().__init__(CableSimulator(BLOCKED_TASK), SensingConfig(), 0)
        self.known_from = known_from

    @property
    def task(self) -> Task:
        return CARRIED_TASK if self.plant.time < self.known_from else BLOCKED_TASK


@pytest.fixture(scope="module")
def rod_mpc() -> RodMPC:
    return RodMPC()


@pytest.mark.parametrize("known_from", [0.0, 2.0])
def test_what_appears_in_the_way_is_planned_round(rod_mpc: RodMPC, known_from: float) -> None:
    rollout = track(Uncovered(known_from), rod_mpc, CARRIED, recovery=Recovery(replan=planned_back, rest=0.5))
    stood = np.flatnonzero(rollout.status == BLOCKED)
    assert rollout.times[stood[0]] == pytest.approx(known_from)
    assert len(stood) == 5
    assert not rollout.actions[stood].any()
    assert len(rollout.metadata["recovered"]) == 1
    assert rollout.metadata["outcome"] == "settled"
    assert min(rollout.clearance.min(), rollout.gripper_clearance.min()) > 0
    assert stacked(rollout.keypoints[-1], CARRIED_TASK.goal) < 0.005


def test_without_recovery_the_controller_is_told_and_goes_as_far_as_it_can(rod_mpc: RodMPC) -> None:
    rollout = track(Uncovered(2.0), rod_mpc, CARRIED)
    assert BLOCKED not in rollout.status
    assert stacked(rollout.keypoints[-1], CARRIED_TASK.goal) > 0.03


def test_where_there_is_no_way_round_the_run_ends_standing(rod_mpc: RodMPC) -> None:
    def nowhere(task: Task, left: Plan) -> Plan:
        raise PlanningError("there is no plan: walled in")

    rollout = track(Uncovered(1.0), rod_mpc, CARRIED, recovery=Recovery(replan=nowhere))
    assert (rollout.outcome, rollout.detail) == ("blocked way", "there is no plan: walled in")
    assert rollout.clearance.min() > 0


def with_disc(center: np.ndarray, radius: float) -> Task:
    disc = Disc(center=(float(center[0]), float(center[1])), radius=radius)
    return replace(CARRIED_TASK, scene=replace(CARRIED_TASK.scene, obstacles=(disc,)))


@pytest.mark.parametrize(("depth", "blocked"), [(0.004, False), (0.008, True)])
def test_a_little_in_the_way_is_left_to_the_controller(depth: float, blocked: bool) -> None:
    """A disc that the arc grazes half way, as deep as that."""
    across = np.array([-0.05, 0.08]) / np.hypot(0.05, 0.08)
    curve = polyline.spline(CARRIED.shapes[20], 20)
    foremost = curve[np.argmax(curve @ across)]
    task = with_disc(foremost + across * (CARRIED_TASK.cable.radius + 0.02 - depth), 0.02)
    watch = Watch(Recovery(replan=planned_back), 0.1)
    assert watch.is_blocked(task, CARRIED, 0.0) == blocked
    assert not watch.is_blocked(CARRIED_TASK, CARRIED, 0.0)


def test_what_the_cable_has_passed_is_not_in_its_way() -> None:
    task = with_disc(CARRIED.shapes[10][2], 0.003)
    watch = Watch(Recovery(replan=planned_back, room=0.0), 0.1)
    assert watch.is_blocked(task, CARRIED, 0.0)
    assert not watch.is_blocked(task, CARRIED, 0.9)


ASIDE = START + np.array([0.02, -0.01, 0.1, 0.0, 0.0, 0.0])


def test_a_cable_that_lies_elsewhere_is_planned_for_before_it_moves() -> None:
    rollout = track(plant(ASIDE), EAGER, PLAN, recovery=Recovery(replan=planned_back, rest=0.5))
    assert list(rollout.status[:5]) == [LOST] * 5
    assert rollout.metadata["recovered"] == [pytest.approx(0.5)]
    assert stacked(rollout.keypoints[-1], TASK.goal) < 0.005
    near = track(plant(SHIFTED), EAGER, PLAN, recovery=Recovery(replan=planned_back))
    assert LOST not in near.status[: PLAN.steps]


@pytest.mark.parametrize("times", [0, 2])
def test_the_first_plan_is_followed_where_there_is_none_from_elsewhere(mpc: NeuralMPC, times: int) -> None:
    def nowhere(task: Task, left: Plan) -> Plan:
        raise PlanningError("nowhere to go")

    rollout = track(plant(ASIDE), mpc, PLAN, recovery=Recovery(replan=nowhere, rest=0.5, times=times))
    assert not rollout.metadata["recovered"]
    assert rollout.metadata["outcome"] == "settled"
    assert stacked(rollout.keypoints[-1], TASK.goal) < 0.01
