"""Recordings of a cable between two grippers, of any rate and unit, as transitions; docs/datasets.md has the files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from jaxtyping import Float

from cableway.core.errors import FileFormatError, InputError, TaskError
from cableway.core.provenance import versions
from cableway.core.quantities import limit_text
from cableway.datasets.ends import held_at_ends, require_at_ends
from cableway.datasets.rows import Rows, read_rows
from cableway.datasets.steps import stretches, transitions
from cableway.datasets.transitions import Transitions
from cableway.geometry.polyline import length, resample
from cableway.geometry.projective import mapped, plane_map
from cableway.scene.cable import Cable
from cableway.scene.checks import COORDINATE, LENGTH, PER_UNIT, AngleUnit, Quantity, length_unit
from cableway.scene.files.document import read_document
from cableway.scene.files.loading import cable_of_section
from cableway.scene.files.schema import Point, validate
from cableway.scene.task import CONTROL_STEP

ROWS = (".csv", ".npz")
DESCRIPTIONS = (".yaml", ".yml")
SUFFIXES = (*ROWS, *DESCRIPTIONS)
"""Endings of recordings."""

LENGTHS = (0.5, 1.25)
"""Least and greatest length of the keypoints' polyline, over the length that is said of the cable. Simulated cables
that compress were at 0.8 in the median."""

Seconds = "a number in seconds"
Pixel = Annotated[tuple[float, float], "two numbers [u, v]"]


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """Where points of the picture are on the table: of 3 an affine map, of 4 a projective one.

    Attributes:
        pixels: 3 or 4 points [u, v] of the picture.
        table: The same points [m] on the table.
    """

    pixels: Annotated[list[Pixel], "a list of 3 or 4 points [u, v]"]
    table: Annotated[list[Point], "a list of 3 or 4 points [x, y]"]

    def on_table(self, points: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "... 2"]:
        """Points of the picture on the table [m]; NaN beyond its horizon.

        Raises:
            InputError: The calibration is none.
        """
        return mapped(plane_map(np.array(self.pixels, float), np.array(self.table, float)), points)


@dataclass(frozen=True, kw_only=True)
class Description:
    """What a recording's YAML file says of it; the defaults hold for a CSV or NPZ file alone.

    Attributes:
        cableway: Version of the format.
        file: The CSV or NPZ file, seen from the folder of the YAML file.
        units: Of lengths in both files; with px those of the keypoints are pixels, all others metres.
        angles: Of angles in both files.
        scale: Metres per pixel, seen from straight above.
        calibration: In place of `scale`.
        gap: Longest time between two values that is bridged [s].
        segment: Longest episode [s]; longer stretches are cut.
        cable: As in a task; with `keypoints`, shapes are resampled to so many at equal arc length.
    """

    cableway: Annotated[int, "the format version, 1"]
    file: Annotated[str, "the name of a CSV or NPZ file"]
    units: Annotated[Literal["m", "cm", "mm", "px"], "m, cm, mm or px"] = "m"
    angles: Annotated[AngleUnit, "rad or deg"] = "rad"
    scale: Annotated[float | None, "a number in metres per pixel", Quantity("m/px", 1e-7, 1.0)] = None
    calibration: Annotated[Calibration | None, "a mapping of pixels and table"] = None
    gap: Annotated[float, Seconds, Quantity("s", 1e-3, 1.0)] = 0.25
    segment: Annotated[float, Seconds, Quantity("s", CONTROL_STEP, 3600.0)] = 6.0
    cable: Annotated[Cable | None, "a mapping"] = None

    @property
    def lengths(self) -> str:
        """The unit of lengths that are not pixels."""
        return length_unit(self.units)

    def other_unit(self, value: float, bounds: Quantity) -> str:
        """Asks whether a length in the file's unit, out of bounds, is meant in another one; empty if in none."""
        fits = [
            unit for unit in ("mm", "cm", "m")
            if unit != self.units != "px" and bounds.least <= abs(value) / PER_UNIT[unit] <= bounds.most
        ]  # fmt: skip
        return f": is it in {fits[0]}? Say `units: {fits[0]}` in a YAML file that names this one" if fits else ""


def is_recording(path: Path | str) -> bool:
    """Whether a path is that of a recording, and not the folder of a data set."""
    return Path(path).suffix.lower() in SUFFIXES and not Path(path).is_dir()


def load_recording(path: Path) -> Transitions:
    """The transitions of a recording.

    Args:
        path: A CSV or NPZ file in metres and radians, or the YAML file of a `Description`.

    Returns:
        One episode for each segment. `metadata["config"]` says what was made of the recording: its rows and rate [Hz],
        where the poses are from, the cable with its length [m], seconds recorded and used.

    Raises:
        FileFormatError: A file cannot be read, or holds what no recording can; the message names file, row and value.
        TaskError: The YAML file says what no recording can have.
    """
    about, cable = _described(path)
    file = path if path.suffix.lower() in ROWS else path.parent / about.file
    if file.suffix.lower() not in ROWS:
        raise FileFormatError(f"{path}: file must be the name of a CSV or NPZ file, got {about.file!r}")
    rows = read_rows(file)
    try:
        keypoints, poses = _on_table(rows, about)
        parts = list(stretches(rows.times, rows.episode, keypoints, poses, about.gap))
        if not parts:
            raise FileFormatError(_nothing(rows, about))
        ends = [held_at_ends(shapes) if given is None else given for shapes, given in parts]
        shapes = [_resampled(shapes, cable.get("keypoints")) for shapes, _ in parts]
        made = transitions(shapes, ends, max(1, round(about.segment / CONTROL_STEP)))
        measured = _measured(made.keypoints, cable, about)
        if poses is not None:
            require_at_ends(made.keypoints, made.poses, measured)
    except InputError as error:
        raise FileFormatError(f"{file}: {error}") from None
    steps = np.diff(rows.times)[np.diff(rows.episode) == 0]
    config = {
        "source": str(file),
        "rows": len(rows.times),
        "rate": float(1 / np.median(steps)),
        "poses": "from the cable's ends" if poses is None else "recorded",
        "cable": {"length": measured, "keypoints": made.keypoints.shape[1], **cable},
        "length_measured": measured,
        "gap": about.gap,
        "segment": about.segment,
        "seconds_recorded": float(steps.sum()),
        "seconds_used": CONTROL_STEP * len(made),
        "segments": int(made.episode[-1]) + 1,
        "not_read": list(rows.unread),
    }
    return replace(made, metadata={"config": config, "versions": versions()})


def in_words(config: Mapping[str, Any]) -> str:
    """What was made of a recording, from its `config`."""
    source = "measured" if config["cable"]["length"] == config["length_measured"] else "said"
    unread = f"; not read: {', '.join(config['not_read'])[:80]}" if config["not_read"] else ""
    return (
        f"{config['source']}: {config['rows']} rows at {config['rate']:.3g} Hz; "
        f"{config['seconds_used']:.1f} of {config['seconds_recorded']:.1f} s in {config['segments']} segments; "
        f"gripper poses {config['poses']}; length {limit_text(config['cable']['length'])}, {source}{unread}"
    )


def _described(path: Path) -> tuple[Description, dict[str, Any]]:
    """What is said of a recording, and the fields of its cable that are said."""
    if path.suffix.lower() in ROWS:
        return Description(cableway=1, file=path.name), {}
    document = read_document(path)
    content = validate(document, Description)
    section = content.get("cable", {})
    try:
        if content.get("calibration"):
            content = {**content, "calibration": Calibration(**content["calibration"])}
        about = Description(**{**content, "cable": cable_of_section(section) if section else None})
        known = (about.scale is not None) + (about.calibration is not None)
        if known != (about.units == "px"):
            raise TaskError("must have either scale or calibration if units are px, and neither if they are not")
    except TaskError as error:
        raise document.locate(error) from None
    fields = {} if about.cable is None else about.cable.as_dict()
    said = fields.keys() - {"keypoints"} | section.keys() if "preset" in section else section.keys()
    return about, {name: value for name, value in fields.items() if name in said}


def _on_table(rows: Rows, about: Description) -> tuple[Float[np.ndarray, "m n 2"], Float[np.ndarray, "m 2 3"] | None]:
    """Keypoints and poses in metres and radians, in one frame."""
    metres, radians = PER_UNIT[about.lengths], PER_UNIT[about.angles]
    poses = None if rows.poses is None else rows.poses / np.array([metres, metres, radians])
    if about.scale is not None and poses is not None:
        raise FileFormatError(
            "gripper poses need a calibration of the pixels; with a scale, no frame is common to both"
        )
    if about.scale is not None:
        keypoints = rows.keypoints * np.array([about.scale, -about.scale])  # the rows of a picture count downwards
    elif about.calibration is not None:
        keypoints = about.calibration.on_table(rows.keypoints)
        for index in np.argwhere(np.isnan(keypoints) & ~np.isnan(rows.keypoints))[:1]:
            raise FileFormatError(f"{rows.place('keypoints', *index)} is beyond the horizon of the calibration")
    else:
        keypoints = rows.keypoints / metres
    for name, found, recorded in (("keypoints", keypoints, rows.keypoints), ("poses", poses, rows.poses)):
        if found is None or recorded is None:
            continue
        for index in np.argwhere(np.abs(found[..., :2]) > COORDINATE.most)[:1]:
            value = float(recorded[tuple(index)])
            raise FileFormatError(
                f"{rows.place(name, *index)} is {value:g} {about.units}, farther than {COORDINATE.most:g} m from the "
                f"origin{about.other_unit(value, COORDINATE)}"
            )
    return keypoints, poses


def _nothing(rows: Rows, about: Description) -> str:
    """Why a recording has no transition."""
    apart = float(np.median(np.diff(rows.times)))
    return (
        f"no two successive steps of {CONTROL_STEP} s have all keypoints and poses without a gap of more than "
        f"{about.gap:g} s; the rows are {apart:.3g} s apart, in the median"
    )


def _resampled(shapes: Float[np.ndarray, "k n 2"], count: int | None) -> Float[np.ndarray, "k m 2"]:
    return shapes if count is None else np.stack([resample(shape, count) for shape in shapes])


def _measured(keypoints: Float[np.ndarray, "k n 2"], cable: Mapping[str, Any], about: Description) -> float:
    """The length [m] of the cable along its keypoints, in the median; that of a cable, and of the one that is said."""
    measured = float(np.median(length(keypoints)))
    if not LENGTH.least <= measured <= LENGTH.most:
        own = measured * PER_UNIT[about.lengths]
        raise FileFormatError(
            f"the cable is {own:.4g} {about.lengths} long, not {LENGTH.least:g} to {LENGTH.most:g} m"
            f"{about.other_unit(own, LENGTH)}"
        )
    said = cable.get("length", measured)
    if not LENGTHS[0] * said <= measured <= LENGTHS[1] * said:
        raise FileFormatError(
            f"the cable measures {limit_text(measured)} along its keypoints, but cable.length says {limit_text(said)}"
        )
    return measured
