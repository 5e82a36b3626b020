"""`cableway run`: plan a task, then lead the simulated cable along the plan in closed loop."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cableway.cli.options import Flag, Maybe, option
from cableway.cli.planning import CONTROLLER_NAMES, PlanOptions
from cableway.core.errors import InputError, UnknownNameError
from cableway.core.plugins import is_plugin
from cableway.workflow.registry import DEFAULT_CONTROLLER

if TYPE_CHECKING:
    from cableway.scene.spatial.task import SpatialTask
    from cableway.tracking.eyes import EyesConfig


@dataclass(frozen=True, kw_only=True)
class Run(PlanOptions):
    """Plan a task and track the plan: the files of `plan`, and rollout.npz, rollout.png, rollout.mp4; replanning.png
    where a new plan was made on the way, estimates.png where the cable was found to differ."""

    plan_file: Annotated[Path | None, option(name="from", metavar="PLAN.npz")] = None
    """Track this plan of the task, such as one of `plan --alternatives`, instead of seeking one, as by default."""

    controller: Annotated[str | None, option(metavar=CONTROLLER_NAMES)] = None
    """The controller, or a class of your own, whose code is run; by default rod-mpc, neural-mpc with a --model."""

    model: Maybe[str] = None
    """Deformation model of neural-mpc or tang2025: bilstm, conv, hybrid, linear, mlp, rod, transformer, tang2025-bdm,
    tang2025-cdm, tang2025-tdm, or a .safetensors file; by default, conv and tang2025-tdm."""

    adapt: Flag = False
    """Adapt the model to the cable while it runs."""

    plant: Annotated[str | None, option(metavar="{FILE.yaml,package.module:Class}")] = None
    """Perturbations of the simulated plant (cable, grasp, noise, latency), or another plant, whose code is run.
    By default, the task's cable without noise, in a cell held by simulated arms."""

    camera: Annotated[str | None, option(metavar="above,front,back,left,right")] = None
    """Places of cameras, one or more: the controller knows the cable by their rendered pictures alone. By default, it
    gets the keypoints of the plant."""

    tracker: Annotated[str | None, option(metavar="{rod,markers}")] = None
    """What finds the cable in the pictures of the cameras: by its own colour, or by markers on it, too; by default,
    rod."""

    depth: Flag = False
    """The cameras give depths, too: what stands on the table besides the task's obstacles is found by them, and the
    controller knows of nothing else. By default, it knows when the plant says so."""

    deadline: Maybe[float] = None
    """Wall time [s] after which a control step counts as missed, as on a robot; by default, none."""

    speed: float = 1.0
    """Share of the grippers' limits, above 0 and at most 1, for first trials on a robot."""

    dry_run: Flag = False
    """Plan, verify and rehearse on the simulated cable, and say what would be sent to the grippers; nothing moves."""

    no_rehearsal: Flag = False
    """Take the first plan, even for a cable with friction or one that is not uniform."""

    no_video: Flag = False
    """Do not make a video."""

    watch: Flag = False
    """Show the run on a page in the browser (extra studio), until that is closed: the true cable, where it should be,
    what is seen, estimates and clearance. What is simulated takes the time that it says."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.tracker is not None and self.camera is None:
            raise InputError(f"--tracker {self.tracker} finds a cable in pictures, and no --camera takes any")
        if self.depth and self.camera is None:
            raise InputError("--depth is of cameras, and no --camera takes pictures")
        if self.plan_file is None:
            return
        for name in ("planner", "pivot", "time_limit", "no_rehearsal"):
            if getattr(self, name) != getattr(type(self), name):
                option_text = name.replace("_", "-")
                raise InputError(f"--{option_text} says how a plan is found, and --from {self.plan_file} gives one")

    def folder(self, name: str) -> Path:
        """The folder for results; never the one of the plan that is followed, whose plans would be replaced.

        Raises:
            InputError: It is a file, or that folder.
        """
        if self.plan_file is None:
            return super().folder(name)
        folder = super().folder(f"{name}-{self.plan_file.stem}")
        if os.path.realpath(folder) == os.path.dirname(os.path.realpath(self.plan_file)):  # also of links in a circle
            raise InputError(f"--out {folder}: the plans in it would be replaced, {self.plan_file} among them")
        return folder

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        from cableway.core.compiled import clock
        from cableway.scene.task import Task
        from cableway.simulation.perturbations.perturbation import Perturbation
        from cableway.simulation.perturbations.reading import read_perturbation

        since = clock()
        spatial = self.load_any()
        if not isinstance(spatial, Task):
            return self._in_space(spatial, since)
        task = self.load()
        own = self.plant if self.plant is not None and is_plugin(self.plant) else None
        return self.solve(
            task,
            since=since,
            video=not self.no_video,
            watch=self.watch,
            plan=self.plan_file,
            controller=self.controller or (DEFAULT_CONTROLLER if self.model is None else "neural-mpc"),
            model=self.model,
            adapt=self.adapt,
            plant=own,
            perturbation=read_perturbation(Path(self.plant), task) if self.plant and not own else Perturbation(),
            eyes=self._eyes(),
            deadline=self.deadline,
            speed=self.speed,
            dry_run=self.dry_run,
            rehearse=not self.no_rehearsal,
        )

    def _in_space(self, task: SpatialTask, since: float) -> int:
        from cableway.cli.in_space import leave_in_space, refuse
        from cableway.simulation.perturbations.spatial_reading import read_spatial_perturbation
        from cableway.tracking.spatial_eyes import SETUP
        from cableway.workflow.spatial_run import CONTROLLERS

        default = {field.name: field.default for field in fields(self)}
        chosen = {
            f"--{name.replace('_', '-')}": getattr(self, name) != default[name]
            for name in ("model", "adapt", "depth", "deadline", "speed", "dry_run")
        }
        refuse(task, self.planar_options() | chosen | {"--cell": self.cell is not None})
        controller = self.controller or next(iter(CONTROLLERS))
        if controller not in CONTROLLERS:
            raise UnknownNameError("controller in space", controller, CONTROLLERS)
        if self.plant is not None and is_plugin(self.plant):
            raise InputError(f"--plant {self.plant}: in space the plant is the simulated one; give a YAML file")
        perturbation = None if self.plant is None else read_spatial_perturbation(Path(self.plant), task)
        return leave_in_space(
            self, task, since, controller=controller, plan=self.plan_file, perturbation=perturbation,
            eyes=self._eyes(**SETUP), video=not self.no_video, watch=self.watch,
        )  # fmt: skip

    def _eyes(self, **setup: Any) -> EyesConfig | None:
        """The cameras that the options ask for, with a setup of their own."""
        from cableway.tracking.eyes import EyesConfig

        if self.camera is None:
            return None
        given: dict[str, Any] = {} if self.tracker is None else {"tracker": self.tracker}
        return EyesConfig(
            cameras=tuple(self.camera.split(",")), depth=self.depth, seed=self.seed or 0, **given, **setup
        )
