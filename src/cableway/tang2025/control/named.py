"""Neural MPC as the registry of controllers names it. These are for programs: JAX keeps what it compiles."""

from __future__ import annotations

from dataclasses import replace

from cableway.tang2025.control.mpc_config import ADAPT_EVERY, MPCConfig
from cableway.tang2025.control.neural_mpc import NeuralMPC
from cableway.tang2025.models.checkpoint import load_model
from cableway.tang2025.models.compilation import enable_compilation_cache


def neural_mpc(model: str, adapt: bool, config: MPCConfig | None = None) -> NeuralMPC:
    """Our MPC on a learned model.

    Args:
        model: Name of a shipped model, or a .safetensors file.
        adapt: Whether it is adapted to the cable while it runs.
        config: Cost and limits.

    Raises:
        UnknownNameError: There is no such model; the message lists them.
        FileFormatError: The file is no model.
    """
    enable_compilation_cache()
    return NeuralMPC(load_model(model), replace(config or MPCConfig(), adapt_every=ADAPT_EVERY if adapt else 0))


def tang2025(model: str, adapt: bool) -> NeuralMPC:
    """The same with the paper's cost and limits."""
    return neural_mpc(model, adapt, MPCConfig.paper())
