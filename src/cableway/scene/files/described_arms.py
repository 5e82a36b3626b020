"""The file of two arms of any kind: its keys, and what it becomes."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cableway.core.errors import Place, TaskError
from cableway.scene.checks import AngleUnit, LengthUnit
from cableway.scene.described_arms import CLEARANCE, DescribedArm, DescribedArms
from cableway.scene.files.document import read_document
from cableway.scene.files.schema import FORMAT_VERSION, validate
from cableway.scene.obstacles import Height


@dataclass(frozen=True, kw_only=True)
class DescribedArmsFile:
    """All keys of the file."""

    cableway: Annotated[int, f"the format version, {FORMAT_VERSION}"]
    units: Annotated[LengthUnit, "m, cm or mm"] = "m"
    angles: Annotated[AngleUnit, "rad or deg"] = "rad"
    name: Annotated[str, "a short text"]
    arms: Annotated[list[DescribedArm], "a list of two arms"]
    clearance: Annotated[float, "a length", CLEARANCE] = DescribedArms.clearance
    obstacle_height: Height = None


def load_described_arms(path: str | os.PathLike[str]) -> DescribedArms:
    """The arms of a YAML file; files that it names are found beside it.

    Raises:
        TaskError: The file is not one of arms; the message has the place.
        FileFormatError: It cannot be read.
    """
    path = Path(path)
    document = read_document(path)
    content = validate(document, DescribedArmsFile)
    place: Place = ()
    try:
        arms = []
        for index, section in enumerate(content["arms"]):
            place = ("arms", index)
            arms.append(DescribedArm(**{**section, "model": str(path.parent / section["model"])}))
        place = ()
        given = {key: value for key, value in content.items() if key not in ("cableway", "units", "angles")}
        return DescribedArms(**{**given, "arms": tuple(arms)})
    except TaskError as error:
        raise document.locate(error.within(*place)) from None
