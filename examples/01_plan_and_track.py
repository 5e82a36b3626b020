"""Solve a task: plan how a cable gets past an obstacle, and track the plan.

`solve` plans, rehearses if the cable needs it, tracks, replans if the cable leaves its plan, and judges the run. It
reports its progress as events; this script inspects the plan as soon as it is found.
"""

from pathlib import Path

import cableway as cw
from cableway.workflow.events import Event, Planned

task = cw.load_task("single-obstacle-2")


def on_event(event: Event) -> None:
    """Show the plan with the checks that it passed."""
    if isinstance(event, Planned) and event.run.plan is not None:
        print(f"planned {event.run.plan.steps} control steps")
        for check in cw.verify_plan(event.run.plan, task).checks:
            print(f"  {check.name:28} {check.value:10.4g} {check.unit:4} limit {check.limit:g}")


run = cw.solve(task, on_event=on_event)
print(run.report)

out = Path("out")
if run.plan is not None and run.rollout is not None:
    run.plan.save(out / "plan.npz")
    run.rollout.save(out / "rollout.npz")
print("wrote", *sorted(out.iterdir()))
