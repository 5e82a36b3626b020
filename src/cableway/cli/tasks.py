"""`cableway tasks`: the catalogue."""

from __future__ import annotations

from dataclasses import dataclass

from cableway.cli.options import Options
from cableway.cli.outputs import REPORT
from cableway.cli.terminal import Terminal, columns, literal


@dataclass(frozen=True, kw_only=True)
class Tasks(Options):
    """List the tasks of the catalogue."""

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        from cableway.files import write_json
        from cableway.scene.loading import load_task, task_names

        table, rows = columns("task", "cable", "obstacles", "description"), []
        for name in task_names():
            task = load_task(name)
            row = {
                "name": name,
                "description": task.description,
                "cable_length": task.cable.length,
                "cable_radius": task.cable.radius,
                "obstacles": len(task.scene.obstacles),
                "workspace": list(task.scene.size),
            }
            cable = f"{task.cable.length:.3g} m, {2000 * task.cable.radius:.3g} mm"
            table.add_row(literal(name), cable, str(row["obstacles"]), literal(task.description))
            rows.append(row)
        if self.out is not None:
            write_json(self.folder("tasks") / REPORT, {"tasks": rows})
        Terminal(self).result({"tasks": rows}, table)
        return 0
