"""`cableway run`: plan a task, then lead the simulated cable along the plan in closed loop."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from cableway.cli import outputs
from cableway.cli.planning import Planned, PlanOptions, plan_into
from cableway.cli.terminal import Tell, Terminal, pairs
from cableway.core.errors import ControlError, SimulationError
from cableway.workflow.registry import CONTROLLERS, DEFAULT_CONTROLLER, controller_is_compiled, make_controller

if TYPE_CHECKING:
    from cableway.control.base import Controller
    from cableway.records import Plan, Rollout
    from cableway.report import Report
    from cableway.scene.task import Task
    from cableway.simulation.perturbations.perturbation import Perturbation
    from cableway.tracking import Watchdog


AHEAD = "The controller is compiled once before it starts; the next run finds it in your cache folder."


@dataclass(frozen=True, kw_only=True)
class _Tracked:
    """What became of the plan: along it, and into the port; what was not simulated; what stopped it early, if so."""

    rollout: Rollout | None = None
    insertion: Rollout | None = None
    notes: tuple[str, ...] = ()
    problem: str | None = None


@dataclass(frozen=True, kw_only=True)
class Run(PlanOptions):
    """Plan a task and track the plan: the files of `plan`, and rollout.npz, rollout.png, rollout.mp4."""

    controller: Annotated[str | None, tyro.conf.arg(metavar="{" + ",".join(CONTROLLERS) + "}")] = None
    """What leads the grippers; rod-mpc unless given, neural-mpc where a model is."""

    model: str | None = None
    """Deformation model of neural-mpc: a shipped model's name, or a .safetensors file; conv unless given."""

    adapt: bool = False
    """Adapt the model of neural-mpc to the cable while it runs."""

    plant: Path | None = None
    """YAML file that says how the simulated cable differs from the task's and how it is seen: noise, delays."""

    deadline: float | None = None
    """Wall time [s] after which a control step counts as missed, as on a robot; none unless given."""

    no_rehearsal: bool = False
    """Take the first plan, also for a cable that friction holds or that is not the same everywhere."""

    no_video: bool = False
    """Leave out the video."""

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        from cableway.scene.files.loading import load_task
        from cableway.simulation.perturbations.perturbation import Perturbation
        from cableway.simulation.perturbations.reading import read_perturbation
        from cableway.tracking import Watchdog

        terminal, task = Terminal(self), load_task(self.task)
        perturbation = Perturbation() if self.plant is None else read_perturbation(self.plant, task)
        watchdog = Watchdog(deadline=self.deadline)
        folder, controller = self.folder(task.name), make_controller(self._name, self.model, self.adapt)
        if not controller_is_compiled(self._name):
            terminal.note(AHEAD)
        with terminal.progress() as tell:
            planned = plan_into(folder, task, self, terminal, tell, rehearsal=not self.no_rehearsal)
            report = planned.report
            if planned.plan is not None:
                report = self._track_into(folder, task, planned, perturbation, controller, watchdog, tell)
        outputs.announce(terminal, folder, report)
        terminal.result(report.as_dict(), pairs(report.rows()))
        return 0 if report.success else 1

    @property
    def _name(self) -> str:
        """Of the controller."""
        return self.controller or (DEFAULT_CONTROLLER if self.model is None else "neural-mpc")

    def _track_into(
        self,
        folder: Path,
        task: Task,
        planned: Planned,
        perturbation: Perturbation,
        controller: Controller[Any],
        watchdog: Watchdog,
        tell: Tell,
    ) -> Report:
        """Track the plan, leave rollout, pictures and report in the folder, and return the report."""
        from cableway.figures.insertion import insertion_figure
        from cableway.figures.rollout import rollout_figure
        from cableway.figures.style import save_figure
        from cableway.figures.video import write_video
        from cableway.report import summarize

        tracked = self._track(task, planned, perturbation, controller, watchdog, tell)
        rollout, insertion = tracked.rollout, tracked.insertion
        report = summarize(
            task, planned.plan, rollout, push=planned.push, insertion=insertion, timings=planned.timings,
            seed=self.seed or 0, notes=[*planned.notes, *perturbation.notes, *tracked.notes],
            limits=planned.config.limits, cable=perturbation.cable, problem=tracked.problem,
        )  # fmt: skip
        if rollout is not None:
            rollout.save(folder / outputs.ROLLOUT)
            save_figure(rollout_figure(task, rollout), folder / outputs.ROLLOUT_PICTURE)
        if insertion is not None:
            insertion.save(folder / outputs.INSERTION)
            save_figure(insertion_figure(task, insertion), folder / outputs.INSERTION_PICTURE)
        outputs.write_report(folder, report)
        if rollout is not None and not self.no_video:
            write_video(folder / outputs.VIDEO, task, rollout, progress=tell)
        return report

    def _track(
        self,
        task: Task,
        planned: Planned,
        perturbation: Perturbation,
        controller: Controller[Any],
        watchdog: Watchdog,
        tell: Tell,
    ) -> _Tracked:
        """Track the plan and, where the task has a port and the goal was reached, push the plug in."""
        from cableway.core.compiled import mark_compiled
        from cableway.core.provenance import versions
        from cableway.tracking import Recovery, may_push, push_in, track

        assert planned.plan is not None
        tell("track", 0.0)
        notes: tuple[str, ...] = ()
        rollout, insertion = None, None
        try:
            plant = perturbation.build(task, self.seed or 0)
            notes = plant.plant.unmodelled
            # what does not look at the cable does not notice that it has left the plan
            recovery = None if self._name == "open-loop" else Recovery(replan=self._replan)
            seed = self.seed or 0
            rollout = track(
                plant, controller, planned.plan, recovery=recovery, watchdog=watchdog, progress=tell, seed=seed
            )
            if planned.push is not None and may_push(rollout, task):
                insertion = push_in(
                    plant,
                    planned.push,
                    watchdog=watchdog,
                    progress=lambda _, share: tell("insertion", share),
                    seed=seed,
                )
        except (SimulationError, ControlError) as error:
            return _Tracked(rollout=rollout, notes=notes, problem=f"tracking failed: {error}")
        if CONTROLLERS[self._name].model is None:
            mark_compiled("control")
        made_by: dict[str, Any] = {"versions": versions(), "plant": perturbation.as_dict(task)}
        if (model := CONTROLLERS[self._name].model) is not None:
            made_by["model"] = self.model or model
        rollout, insertion = (
            None if part is None else replace(part, metadata={**made_by, **part.metadata})
            for part in (rollout, insertion)
        )
        return _Tracked(rollout=rollout, insertion=insertion, notes=notes)

    def _replan(self, task: Task, left: Plan) -> Plan:
        """A plan from where the cable is, sought first along the one that it left."""
        from cableway.planning.planner import plan

        deadline = time.monotonic() + self.time_limit
        return plan(
            task,
            seed=self.seed or 0,
            config=self.planner_config(),
            previous=left,
            expired=lambda: time.monotonic() > deadline,
        )
