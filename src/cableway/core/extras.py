"""Packages that only an extra installs: `pip install 'cableway[EXTRA]'`."""

from __future__ import annotations

import sys
from importlib.util import find_spec

from cableway.core.errors import MissingExtraError

EXTRAS = {
    "arms": {"coal": "Coal", "mink": "mink"},
    "cell": {"coal": "Coal"},
    "data": {"pyarrow": "pyarrow"},
    "gym": {"gymnasium": "Gymnasium"},
    "import": {"ezdxf": "ezdxf", "svgpathtools": "svgpathtools"},
    "ray": {"ray": "Ray"},
    "realsense": {"pyrealsense2": "librealsense"},
    "studio": {"viser": "viser"},
    "tang2025": {"casadi": "CasADi", "equinox": "Equinox", "jax": "JAX", "optax": "Optax"},
    "ur": {"rtde_control": "ur-rtde"},
    "vision": {"cv2": "OpenCV"},
}
"""By extra: its packages and what they are called. OMPL, for Linux only, is looked for where it is used."""


def require(extra: str, user: str) -> None:
    """Make sure that the packages of an extra are installed, without importing them.

    Args:
        extra: One of `EXTRAS`.
        user: What needs them; the message begins with it.

    Raises:
        MissingExtraError: One is missing.
    """
    missing = [called for package, called in EXTRAS[extra].items() if not _installed(package)]
    if missing:
        names = " and ".join([", ".join(missing[:-1]), missing[-1]] if len(missing) > 1 else missing)
        verb = "are" if len(missing) > 1 else "is"
        raise MissingExtraError(f"{user} needs {names}, which {verb} not installed: pip install 'cableway[{extra}]'")


def _installed(package: str) -> bool:
    if package in sys.modules:
        return sys.modules[package] is not None
    return find_spec(package) is not None
