"""`cableway export`: a plan or a rollout as gripper poses and joints by time, for robots; runs for learning."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from cableway.cli.export_data import KINDS as DATA
from cableway.cli.export_data import export_data
from cableway.cli.options import Flag, Maybe, Options, option
from cableway.cli.outputs import PLAN, TASK
from cableway.cli.terminal import Terminal, pairs
from cableway.core.errors import InputError, UnknownNameError
from cableway.core.quantities import limit_text, quantity

if TYPE_CHECKING:
    from cableway.scene.task import Task
    from cableway.workflow.trajectory import Format, Trajectory


@dataclass(frozen=True, kw_only=True)
class Export(Options):
    """Write gripper poses, and joints of arms, by time, for robots: CSV, JSON, URScript, ROS 2; a header says units.
    Or collected runs, for learning: Parquet, LeRobot (pip install 'cableway[data]')."""

    run: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RUN")]
    """Folder of a run, for its plan.npz; or a plan.npz or rollout.npz. With --format parquet or lerobot, a folder of
    collected runs."""

    out: Maybe[Path] = None
    """A file ending in .csv, .json, .script or .yaml, the last two with -left and -right before that; by default,
    runs/export/<task>-<name of the file>. With --format parquet or lerobot, a folder."""

    format: Annotated[str | None, option(metavar="{csv,json,urscript,ros,parquet,lerobot}")] = None
    """By default, what the ending of --out says, or csv."""

    task: Maybe[str] = None
    """The task that it is of; by default, the task.yaml beside it."""

    rate: Maybe[float] = None
    """Rows per second on a smooth curve that keeps the limits of the rows; by default, 125 for urscript, 10 for ros,
    and for csv and json the rows as they are."""

    arms: Maybe[Path] = None
    """YAML file of two arms of any kind, each described by an MJCF or URDF file: with their joints along the plan, by
    differential inverse kinematics (pip install 'cableway[arms]')."""

    cable: Flag = False
    """The keypoints of the cable, too."""

    unverified: Flag = False
    """Export it even if it does not verify; the header says so."""

    failures: Flag = False
    """With --format parquet or lerobot: runs that did not succeed, too."""

    camera: Annotated[str | None, option(metavar="{above,front,back,left,right}")] = None
    """With --format lerobot: where a camera stands whose video is rendered for each run; by default, there is none."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.camera is not None and self.format != "lerobot":
            raise InputError("--camera: only goes with --format lerobot")
        if self.failures and self.format not in DATA:
            raise InputError(f"--failures: only goes with --format {' or '.join(DATA)}")
        if self.format in DATA:
            for name in ("task", "rate", "cable", "unverified", "arms"):
                if getattr(self, name):
                    raise InputError(f"--{name}: does not go with --format {self.format}")

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        if self.format in DATA:
            return export_data(self, self.format)
        from cableway.scene.files.described_arms import load_described_arms
        from cableway.workflow.reading import read_record
        from cableway.workflow.trajectory import Trajectory

        kind = self._kind()
        file = self.run / PLAN if self.run.is_dir() else self.run
        record, task = read_record(file), self._load(file)
        rate = kind.rate if self.rate is None else self.rate
        trajectory = Trajectory.of(
            record, task, rate=rate, cable=self.cable, unverified=self.unverified, source=str(file),
            arms=None if self.arms is None else load_described_arms(self.arms),
        )  # fmt: skip
        path = self.out or self.folder("export") / f"{task.name}-{file.stem}{kind.suffix}"
        written = [str(each) for each in trajectory.write(path)]
        report = {"files": written, "rows": len(trajectory.times), "header": trajectory.header}
        Terminal(self).result(report, pairs(_rows(trajectory, written)))
        return 0

    def _kind(self) -> Format:
        """The format asked for.

        Raises:
            InputError: There is none of that name or ending, or the two do not go together.
        """
        from cableway.workflow.trajectory import FORMATS, format_of

        name = self.format or ("csv" if self.out is None else format_of(self.out))
        if name not in FORMATS:
            raise UnknownNameError("format", name, (*FORMATS, *DATA))
        kind = FORMATS[name]
        if self.arms is not None and name == "urscript":
            raise InputError("--arms: URScript is for arms of Universal Robots in a cell")
        if self.out is not None and self.out.suffix.lower() != kind.suffix:
            raise InputError(f"--out {self.out} must end in {kind.suffix} with --format {name}")
        return kind

    def _load(self, file: Path) -> Task:
        from cableway.scene.files.loading import load_planar_task

        beside = file.with_name(TASK)
        if self.task is None and not beside.is_file():
            raise InputError(f"{beside}: no such file; --task must say what {file} is of")
        return load_planar_task(self.task or beside)


def _rows(trajectory: Trajectory, written: list[str]) -> list[tuple[str, str]]:
    """Names and values as text with units."""
    header = trajectory.header
    reached, limits, off = header["reached"], header["limits"], header["off_rows"]
    units = dict(zip(limits, ("m/s", "rad/s", "m/s²", "rad/s²", "m/s³", "rad/s³"), strict=True))
    rows = [
        *(("file", each) for each in written),
        ("task", header["task"]),
        ("rows", f"{len(trajectory.times)} in {header['duration']:.2f} s"),
        ("verified", header["verified"]),
        ("off the rows", f"at most {quantity(off['distance'])}, {quantity(off['turn'], 'rad')}"),
    ]
    for name, unit in units.items():
        limit = "none" if limits[name] is None else limit_text(limits[name], unit)
        rows.append((name.replace("_", " "), f"{quantity(reached[name], unit)}, limit {limit}"))
    if trajectory.joints is not None:
        rows += [
            (f"joint {name}", quantity(value, unit))
            for (name, value), unit in zip(header["joints"]["reached"].items(), ("rad/s", "rad/s²"), strict=True)
        ]
    if trajectory.hands is not None:
        commands = (
            f"{limit_text(each['opening']) if each['opening'] else 'closed'} from {each['time']:.1f} s on"
            for each in header["hands"]["commands"]
        )
        rows.append(("hands", ", ".join(commands)))
    return [*rows, ("use", header["use"])]
