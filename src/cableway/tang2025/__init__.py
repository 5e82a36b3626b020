"""The system of Tang, Yang, Huang, Chu and Au (arXiv 2512.24974), whole; it needs the extra `tang2025`.

`planning` has the planning chain, `models` the deformation models with their training and online adaptation, `control`
neural MPC, `reproduction` the paper's tables and figures beside ours. `docs/paper.md` maps each equation, table, figure
and experiment of the paper to its place here, says what departs from it and has the symbols.

Raises:
    MissingExtraError: On import, if the extra is not installed.
"""

from cableway.core.extras import require

require("tang2025", "the system of Tang et al. (its planner, models and neural MPC)")
