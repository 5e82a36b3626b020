from __future__ import annotations

from pathlib import Path

import pytest
from written_sets import SIZES, write_set


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    """A complete data set."""
    write_set(tmp_path / "set", range(len(SIZES)))
    return tmp_path / "set"
