"""The simulated plant (MuJoCo) and data collection from it."""

from __future__ import annotations

import os
import sys


def _load_mujoco() -> None:
    """Import MuJoCo even where MUJOCO_GL names graphics that it does not find: nothing here is drawn with them."""
    try:
        import mujoco
    except (AttributeError, OSError, RuntimeError):
        wanted = os.environ.get("MUJOCO_GL")
        if wanted is None:
            raise
        for name in [name for name in sys.modules if name.partition(".")[0] == "mujoco"]:
            del sys.modules[name]
        os.environ["MUJOCO_GL"] = "disable"
        try:
            import mujoco  # noqa: F401
        finally:
            os.environ["MUJOCO_GL"] = wanted


_load_mujoco()
