"""What the paper reports: Tang et al., "Hierarchical Deformation Planning and Neural Tracking for DLOs in Constrained
Environments" (arXiv 2512.24974). Errors are stacked, in centimetres, mean and standard deviation where it gives both.
"""

from __future__ import annotations

Spread = tuple[float, float]
"""Mean and standard deviation [cm]."""

SIMULATED = {"single-obstacle-2": 2.0, "multi-obstacle-1": 1.0, "maze-1": 2.0}
"""Bounds [cm] on the final error of three simulated tasks ("Simulation Experiments")."""

CONTROL_BY_CABLE: dict[str, Spread] = {
    "paracord": (1.95, 0.9),
    "rubber": (1.56, 0.8),
    "ethernet": (1.69, 0.8),
    "usb": (1.71, 0.9),
}
"""Error [cm] of unconstrained control with the T-DM, ten trials for each cable, table "Deformation Control Results"."""

TRIALS_OF_CONTROL = 10
"""Trials for each cable in that table."""

CONTROL_BY_METHOD: dict[str, Spread] = {
    "broyden": (2.56, 1.53),
    "bdm-mpc": (2.12, 0.73),
    "cdm-mpc": (1.95, 0.91),
    "tdm-mpc": (1.70, 0.86),
}
"""The same by method, by the names that methods have here (table "Deformation Control Comparison")."""

SUMMARY: dict[str, tuple[Spread, Spread, str]] = {
    "real-single": ((1.86, 0.75), (1.51, 1.03), "16/16"),
    "real-multi": ((1.58, 0.82), (0.77, 0.63), "14/16"),
    "real-maze": ((1.94, 0.76), (0.43, 0.19), "14/16"),
}
"""Error and clearance [cm] and successes on real cables, by the catalogue's task (table "Real-world Experiment
Summary")."""

PREDICTION = {"C-DM": 0.547, "B-DM": 0.704}
"""Share by which the T-DM's error at a long horizon is below that of C-DM and B-DM on the USB cable."""

HYPERPARAMETERS = (
    ("pivot path weights k_c, k_l", "1, 1", ("pivot.clearance_weight", "pivot.length_weight")),
    ("virtual stiffness k_1, k_2 [N/m]", "2, 1", ("deformation.near_stiffness", "deformation.far_stiffness")),
    ("time steps T", "50", ("deformation.steps",)),
    ("bounds of a step of sigma", "0.01, 0.1", ("deformation.lower_bound", "deformation.upper_bound")),
    ("distance threshold d [m]", "0.005", ("control.threshold",)),
    ("MPC horizon H", "5", ("control.horizon",)),
    ("MPC iterations, at most", "15", ("control.iterations",)),
    ("lambda_1, lambda_2, lambda_3", "150, 0.01, 1",
     ("control.tracking_weight", "control.obstacle_weight", "control.control_weight")),
)  # fmt: skip
"""Table "Key Hyperparameters": what, its value, and where that is in our configurations of planner and control."""
