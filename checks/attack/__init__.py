"""What a hostile hour does to cableway, drawn from a seed: wrong files, forged records, hostile loops, interrupts."""

import sys
from pathlib import Path

_TESTS = Path(__file__).resolve().parents[2] / "tests"
sys.path += [str(_TESTS / folder) for folder in ("", "verification", "cli", "benchmark", "tracking")]
