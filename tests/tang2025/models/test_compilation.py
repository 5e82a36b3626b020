"""The cache of compiled code, in a process of its own because it changes JAX's configuration."""

from __future__ import annotations

import os
import subprocess
import sys

SCRIPT = """
import jax, jax.numpy as jnp
from cableway.tang2025.models.compilation import enable_compilation_cache
print(enable_compilation_cache())
jax.jit(lambda x: jnp.sin(x) @ x)(jnp.ones((4, 4))).block_until_ready()
"""


def test_a_second_process_finds_what_the_first_one_compiled(tmp_path):
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)

    def run() -> str:
        done = subprocess.run(
            [sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True, check=True
        )
        assert done.stderr == ""
        return done.stdout.strip()

    assert run() == "False"
    entries = sorted(path.name for path in (tmp_path / "cableway" / "jax").iterdir() if "-cache" in path.name)
    assert entries
    assert run() == "True"
    after = sorted(path.name for path in (tmp_path / "cableway" / "jax").iterdir() if "-cache" in path.name)
    assert after == entries
