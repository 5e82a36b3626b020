"""Plan and control a cable held by two grippers among obstacles.

Names are imported when they are first used, so that importing the package costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cableway.api import load_task, plan, summarize
    from cableway.control.neural_mpc import MPCConfig, NeuralMPC
    from cableway.models.checkpoint import load_model
    from cableway.planning.config import PlannerConfig
    from cableway.records import Plan, Rollout, Transitions
    from cableway.scene.cable import Cable
    from cableway.scene.obstacles import Box, Disc, Polygon
    from cableway.scene.scene import Scene
    from cableway.scene.task import Grippers, Task
    from cableway.simulation.plant import CableSimulator
    from cableway.tracking import track
