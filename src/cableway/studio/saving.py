"""The files of a session, which the command line reads and writes, too."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cableway.core.files import only_writer, write_json, write_text
from cableway.records import Plan
from cableway.scene.files.loading import AnyDraft
from cableway.scene.files.saving import save_task
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.perturbations.reading import perturbation_text
from cableway.simulation.perturbations.spatial_reading import spatial_perturbation_text
from cableway.simulation.spatial_perturbation import SpatialPerturbation
from cableway.studio.opening import PLAN, TASK
from cableway.workflow.run import Run
from cableway.workflow.solve_in_space import SpatialRun

OF_A_RUN = ("report.json", "rollout.npz", "insertion.npz", "plant.yaml")
"""What a run leaves besides the task and its plans."""


def write_files(
    folder: Path,
    draft: AnyDraft,
    plans: Sequence[Plan],
    run: Run | SpatialRun | None,
    perturbation: Perturbation | SpatialPerturbation | None = None,
) -> tuple[Path, ...]:
    """Write what there is, in place of what another task left there, and return the files.

    Args:
        folder: Where to.
        draft: To task.yaml.
        plans: To plan.npz, plan-2.npz, ...
        run: To report.json and, as far as it came, rollout.npz and insertion.npz.
        perturbation: Of its plant, to plant.yaml.

    Raises:
        InputError: The draft's values make no task file.
    """
    contents = [(folder / TASK, lambda path: save_task(draft, path))]
    for place, plan in enumerate(plans, start=1):
        contents.append((folder / (PLAN if place == 1 else f"plan-{place}.npz"), plan.save))
    if run is not None:
        contents.append((folder / "report.json", lambda path: write_json(path, run.report.as_dict())))
        inserted = run.insertion if isinstance(run, Run) else None
        for name, rollout in (("rollout.npz", run.rollout), ("insertion.npz", inserted)):
            if rollout is not None:
                contents.append((folder / name, rollout.save))
    if perturbation is not None:
        in_space = isinstance(perturbation, SpatialPerturbation)
        text = spatial_perturbation_text(perturbation) if in_space else perturbation_text(perturbation)
        contents.append((folder / "plant.yaml", lambda path: write_text(path, text)))
    with only_writer(folder):
        for path in (*folder.glob("plan*.npz"), *(folder / name for name in OF_A_RUN)):
            path.unlink(missing_ok=True)
        for path, write in contents:
            write(path)
    return tuple(path for path, _ in contents)
