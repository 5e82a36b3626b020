"""Plans and rollouts from files, whichever they hold."""

from __future__ import annotations

from pathlib import Path

from cableway.core.errors import FileFormatError
from cableway.core.reading import read_arrays
from cableway.records import Plan, Rollout


def read_record(file: Path) -> Plan | Rollout:
    """The plan or the rollout in a file.

    Raises:
        FileFormatError: It is neither a plan nor a rollout.
    """
    arrays = read_arrays(file)
    if "centreline" in arrays:
        return Rollout.from_arrays(arrays, str(file))
    if "shapes" in arrays:
        return Plan.from_arrays(arrays, str(file))
    raise FileFormatError(
        f"{file}: neither a plan (it would have an array 'shapes') nor a rollout ('centreline'); "
        f"it has {', '.join(sorted(arrays)) or 'nothing'}"
    )
