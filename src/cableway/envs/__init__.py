"""A cable between two grippers as a Gymnasium environment; it needs the extra `gym`.

Importing this makes `gymnasium.make("cableway/Cable-v0")` known; see `cableway.envs.cable.CableEnv` for its arguments.

Raises:
    MissingExtraError: Gymnasium is not installed.
"""

from cableway.core.extras import require

require("gym", "cableway.envs")

import gymnasium  # noqa: E402

EPISODE_STEPS = 600
"""Control steps after which an episode is cut short: a minute."""

gymnasium.register("cableway/Cable-v0", entry_point="cableway.envs.cable:CableEnv", max_episode_steps=EPISODE_STEPS)
