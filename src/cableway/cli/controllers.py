"""The controllers that `--controller` knows."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from cableway.core.errors import InputError, UnknownNameError

if TYPE_CHECKING:
    from cableway.cli.terminal import Terminal
    from cableway.control.base import Controller

CONTROLLERS = ("rod-mpc", "neural-mpc", "neural-mpc-paper", "rod-jacobian", "broyden", "open-loop")
"""The first is the default."""

ROD_BASED = ("rod-mpc", "rod-jacobian", "broyden")
"""Those whose kernels Numba compiles."""

MODELS = {"neural-mpc": "conv", "neural-mpc-paper": "transformer"}
"""The deformation models of the neural controllers unless another is given; docs/control.md says why."""

AHEAD = "The controller is compiled once before it starts; the next run finds it in your cache folder."


def make_controller(name: str, model: str | None, terminal: Terminal, adapt: bool = False) -> Controller[Any]:
    """The controller of a name.

    Args:
        name: One of `CONTROLLERS`.
        model: Deformation model, for the neural ones.
        terminal: Told where compilation is ahead.
        adapt: Adapt the model while it runs.

    Raises:
        UnknownNameError: There is no such controller or model; the message lists them.
        InputError: A model is given for a controller that has none, or is to be adapted and can't be.
    """
    if name not in CONTROLLERS:
        raise UnknownNameError("controller", name, CONTROLLERS)
    if name in MODELS:
        return _neural(name, model or MODELS[name], terminal, adapt)
    if model is not None:
        raise InputError(f"--model is for neural-mpc and neural-mpc-paper; {name} has no deformation model to choose")
    if adapt:
        raise InputError(f"--adapt is for neural-mpc and neural-mpc-paper; {name} has no learned model")
    if name == "open-loop":
        from cableway.control.open_loop import OpenLoop

        return OpenLoop()
    from cableway.core.compiled import is_compiled

    if not is_compiled("control"):
        terminal.note(AHEAD)
    if name == "rod-mpc":
        from cableway.control.rod_mpc import RodMPC

        return RodMPC()
    from cableway.control.jacobian import JacobianConfig, JacobianFeedback

    return JacobianFeedback(JacobianConfig() if name == "rod-jacobian" else JacobianConfig.broyden())


def _neural(name: str, model: str, terminal: Terminal, adapt: bool) -> Controller[Any]:
    from cableway.tang2025.control.mpc_config import ADAPT_EVERY, MPCConfig
    from cableway.tang2025.control.neural_mpc import NeuralMPC
    from cableway.tang2025.models.checkpoint import load_model
    from cableway.tang2025.models.compilation import enable_compilation_cache

    predicts = load_model(model)
    if not enable_compilation_cache():
        terminal.note(AHEAD)
    config = MPCConfig.paper() if name == "neural-mpc-paper" else MPCConfig()
    return NeuralMPC(predicts, replace(config, adapt_every=ADAPT_EVERY if adapt else 0))
