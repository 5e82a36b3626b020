"""The second half of a run: the plan is tracked, with recoveries, the plug inserted, and all of it judged."""

from __future__ import annotations

import itertools
import json
import logging
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.commands import Commands
from cableway.control.base import Controller
from cableway.control.insertion import InsertionController
from cableway.core.errors import ControlError, GraspError, SimulationError, TrackingInterrupted
from cableway.core.plugins import is_plugin, load_plugin
from cableway.core.provenance import versions
from cableway.core.quantities import quantity
from cableway.geometry.groups import SE2
from cableway.outcome import Outcome
from cableway.records import Plan, Rollout
from cableway.report import Report, summarize
from cableway.robot.branches import NoMotion, arm_motion
from cableway.scene.cell import Way
from cableway.scene.task import CONTROL_STEP, Task
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.tracking import Recovery, Watchdog, insert_plug, may_insert, track
from cableway.tracking.answers import AnsweringPlant
from cableway.tracking.eyes import SeenPlant
from cableway.workflow.events import Listener, Note
from cableway.workflow.find import search
from cableway.workflow.own_plant import OwnPlant
from cableway.workflow.registry import controller_entry, controller_is_compiled, make_controller
from cableway.workflow.run import Run, SolveOptions

LOGGER = logging.getLogger(__name__)

COMPILING = "Compiling the controller; this happens once, the next run finds it in your cache folder."


def prepare_controller(options: SolveOptions, listener: Listener) -> Controller[Any]:
    """The controller that the options ask for.

    Raises:
        UnknownNameError: There is none of that name, or no such model; the message lists them.
        InputError: A model is given for a controller that has none, or one of the user's own is no controller.
    """
    if not isinstance(options.controller, str):
        return options.controller
    controller = make_controller(options.controller, options.model, options.adapt)
    if is_plugin(options.controller):
        listener.emit(Note(f"The controller {options.controller} runs {load_plugin(options.controller)[1]}."))
    if not controller_is_compiled(options.controller):
        listener.emit(Note(COMPILING))
    return controller


def needs_kernels(options: SolveOptions) -> bool:
    """Whether the controller that the options ask for has kernels to be compiled."""
    return isinstance(options.controller, str) and controller_entry(options.controller).kernels


def follow(
    run: Run, options: SolveOptions, controller: Controller[Any], own: OwnPlant | None, listener: Listener
) -> Run:
    """Track the plan of a run and, where the goal of a task with a port is reached, insert the plug.

    The plant is `own`, or the simulated one where that is None.
    """
    assert run.plan is not None
    task, perturbation, watchdog = run.task, options.perturbation, Watchdog(deadline=options.deadline)
    plant = rollout = insertion = problem = eyes = None
    actual, notes, made_by = task, (), _made_by(task, options, own)
    LOGGER.info("plant: %s", json.dumps(made_by["plant"]))
    try:
        actual = perturbation.true_task(task)
        simulated = own or perturbation.build(task, options.seed, run.plan)
        plant, notes = own or AnsweringPlant(simulated), simulated.unmodelled
        if options.eyes is not None:
            way = Way.of_record(run.plan.metadata)
            eyes = SeenPlant(plant, options.eyes, way, task, actual.scene)
            plant = AnsweringPlant(eyes)
        rollout = track(
            plant, controller, run.plan, recovery=_recovery(options, run.plan), watchdog=watchdog,
            progress=listener.progress, on_row=listener.row, seed=options.seed,
        )  # fmt: skip
        if run.insertion_plan is not None and may_insert(rollout, task):
            insertion = insert_plug(
                plant, run.insertion_plan, controller=InsertionController(known=rollout.estimated()),
                watchdog=watchdog, seed=options.seed, progress=lambda _, share: listener.progress("insertion", share),
                on_row=listener.row,
            )  # fmt: skip
    except (SimulationError, ControlError) as error:
        failed = Outcome.NOT_HELD if isinstance(error, GraspError) else Outcome.PLANT_FAILED
        failed = Outcome.CONTROLLER_FAILED if isinstance(error, ControlError) else failed
        problem = (failed, f"tracking failed: {error}")
    except TrackingInterrupted as stop:
        listener.interrupted = True
        rollout, insertion = (stop.rollout, None) if rollout is None else (rollout, stop.rollout)
    except KeyboardInterrupt:
        listener.interrupted = True
    if listener.interrupted:
        problem = (Outcome.INTERRUPTED, "the run was interrupted")
    elif listener.cancelled:
        problem = (Outcome.INTERRUPTED, "the run was cancelled")
    joints = None if plant is None else plant.joints
    rest = None if joints is None or rollout is None else joints[len(rollout.times) :]
    rollout = _with_arms(_with(rollout, made_by), run, joints, perturbation)
    insertion = _with_arms(_with(insertion, made_by), run, rest, perturbation)
    if rollout is not None and eyes is not None:
        rollout = replace(rollout, metadata={**rollout.metadata, "eyes": eyes.record()})
    run = replace(run, rollout=rollout, insertion=insertion)
    try:
        report = summarize(
            task, run.plan, rollout, insertion_plan=run.insertion_plan, insertion=insertion, timings=run.timings,
            seed=options.seed, notes=(*run.report.notes, *perturbation.notes, *notes, *_of_hands(rollout)),
            limits=options.resolved_planner().limits, cable=perturbation.cable, actual=actual, problem=problem,
            plan_verdict=run.report.plan_verdict, insertion_plan_verdict=run.report.insertion_plan_verdict,
        )  # fmt: skip
    except KeyboardInterrupt:
        listener.interrupted = True
        return stopped(run, "the run was interrupted")
    return _only_rehearsed(run, report) if options.dry_run else replace(run, report=report)


def _only_rehearsed(run: Run, report: Report) -> Run:
    """A run in which nothing was moved, with the figures of its rehearsal and of what would have been sent."""
    rehearsed = [part for part in (run.rollout, run.insertion) if part is not None]
    commands = Commands.of(*rehearsed) if rehearsed else None
    notes = ("Dry run: nothing was moved. The figures are those of the simulated cable.", *report.notes)
    return replace(run, report=replace(report, commands=commands, notes=notes), rollout=None, insertion=None)


def stopped(run: Run, why: str = "the run was cancelled") -> Run:
    """A run that was stopped after planning, with the figures it has."""
    return replace(run, report=replace(run.report, outcome=Outcome.INTERRUPTED, failure=why))


def _recovery(options: SolveOptions, plan: Plan) -> Recovery | None:
    """Replanning from where the cable is, without a rehearsal: first along what is left of the plan, later anew.

    The arms of a cell go on holding the cable as they do.
    """
    if not options.recovers:
        return None
    planner, seeds, way = options.resolved_planner(), itertools.count(options.seed), Way.of_record(plan.metadata)

    def replan(task: Task, left: Plan) -> Plan:
        seed, task = next(seeds), task if way is None else task.held(way)
        return search(task, options, planner, None, seed, previous=left if seed == options.seed else None)

    return Recovery(replan=replan)


def _of_hands(rollout: Rollout | None) -> tuple[str, ...]:
    """Whether arms took hold of the cable and let go of it, for the reader of the report."""
    hands = {} if rollout is None else rollout.metadata.get("hands", {})
    if not hands.get("grasped"):
        return ()
    if hands.get("let_go"):
        moved = quantity(hands["moved"])
        return (
            f"The arms took hold of the cable where it lay, and let go of it at the goal, where it moved by {moved}.",
        )
    why = f": {hands['why']}" if "why" in hands else ""
    return (f"The arms took hold of the cable where it lay, and did not let go of it{why}.",)


def _made_by(task: Task, options: SolveOptions, own: OwnPlant | None) -> dict[str, Any]:
    """What the rollouts come from."""
    plant = options.perturbation.as_dict(task) if own is None else own.as_dict()
    made_by: dict[str, Any] = {"versions": versions(), "plant": plant}
    if isinstance(options.controller, str) and (model := controller_entry(options.controller).model) is not None:
        made_by["model"] = options.model or model
    return made_by


def _with_arms(
    rollout: Rollout | None, run: Run, joints: Float[np.ndarray, "k 2 6"] | None, perturbation: Perturbation
) -> Rollout | None:
    """A rollout with the joints of the arms that held the grippers as they did in the plan: as the plant measured them,
    or else where the grippers were; without where that cannot be, and it says why.
    """
    way = None if run.plan is None else Way.of_record(run.plan.metadata)
    if rollout is None or run.task.cell is None or run.plan is None or way is None:
        return rollout
    if joints is None:
        offsets = np.array([perturbation.grasp.offsets(time - CONTROL_STEP / 2) for time in rollout.times])
        grippers = SE2.compose(rollout.poses, SE2.inverse(offsets))
        motion = arm_motion(grippers, run.task, replace(run.task.cell, way=way), made=True)
        if isinstance(motion, NoMotion):
            return replace(rollout, metadata={**rollout.metadata, "arms": {"fault": motion.reason}})
        joints = motion.joints
    described = {**rollout.metadata, "arms": run.plan.metadata["arms"]}
    return replace(rollout, joints=joints[: len(rollout.times)], metadata=described)


def _with(rollout: Rollout | None, made_by: dict[str, Any]) -> Rollout | None:
    return None if rollout is None else replace(rollout, metadata={**made_by, **rollout.metadata})
