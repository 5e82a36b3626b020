"""The system of Tang, Yang, Huang, Chu and Au (arXiv 2512.24974), whole; it needs the extra `tang2025`.

`planning` has the planning chain, `models` the deformation models with their training and online adaptation, `control`
neural MPC, `reproduction` the paper's tables and figures beside ours. Where an equation of the paper is:

    II         (1) to (3)     state and action: `cableway.records.Observation`, `cableway.records.Rollout`
    III        (4)            path set: `planning.path_set.PathSet`
    III-A      (5)            cost of the pivot path: `cableway.planning.routes.pivot.pivot_cost`;
                              RRT*: `planning.pivot_rrt_star.rrt_star_path`
    III-B                     passages: `cableway.planning.routes.passages.find_passages`
    III-B      (6)            linear transfer: `planning.path_transfer.transferred_paths`
    III-B      (7)            spacing in a passage: `planning.path_set.PathSetConfig.spread`
    IV-A       (8) to (10)    smooth path by weighted segments: `planning.path_curves.SigmoidCurves`
    IV-B       (11), (12)     deformation optimisation: `planning.deformation.optimize_deformation`
    IV-B       (13), (14)     shape at a progress: `planning.path_curves.PathCurves`
    IV-B       (15), (16)     mass-spring energy and objective: `planning.springs.Springs`
    V-A        (17)           deformation model: `models.base.DeformationModel`; T-DM: `models.transformer`
    V-A        (18)           training: `models.training.train`; online adaptation: `models.adaptation.adapt`
    V-B        (19)           neural MPC: `control.neural_mpc.NeuralMPC`; prediction: `models.base.rollout`
    V-B        (20)           deformation tracking: `control.terms.tracking`
    V-B        (21) to (23)   obstacle avoidance: `control.terms.clearance`
    V-B        (24)           control regularisation: `control.terms.deviation`
    V-B        (25)           weighted sum: `control.horizon.HorizonCost`
    VI, VII                   experiments: `reproduction.reproduction`, `reproduction.case_studies`;
                              C-DM and B-DM: `models.networks.Convolutional`, `models.networks.Recurrent`
    "Key Hyperparameters"     `planning.config.paper_planner`, `control.mpc_config.MPCConfig.paper`

`docs/derivations.md` has the equations, the symbols and each departure from the paper.

Raises:
    MissingExtraError: On import, if the extra is not installed.
"""

from cableway.core.extras import require

require("tang2025", "the system of Tang et al. (its planner, models and neural MPC)")
