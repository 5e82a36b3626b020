"""Plan a cable past an obstacle and lead it there.

The planner returns a plan only when an independent judge has passed it; here the judge is asked once more, so that its
checks can be seen. Then a simulated cable is led along the plan in closed loop.
"""

from pathlib import Path

import cableway as cw

task = cw.load_task("single-obstacle-2")
plan = cw.plan(task, seed=0)
print(f"planned {plan.steps} control steps")
for check in cw.verify_plan(plan, task).checks:
    print(f"  {check.name:28} {check.value:10.4g} {check.unit:4} limit {check.limit:g}")

controller = cw.RodMPC()
rollout = cw.track(cw.CableSimulator(task), controller, plan)
print(cw.summarize(task, plan, rollout))

out = Path("out")
plan.save(out / "plan.npz")
rollout.save(out / "rollout.npz")
print("wrote", *sorted(out.iterdir()))
