"""Independent judgement of plans and rollouts.

Nothing here shares code with what makes a plan: clearance is measured with Shapely on dense polylines, and the rod
that must follow a plan is solved in link angles instead of centre coordinates.
"""

from cableway.verification.plan import VerificationLimits, verify_plan
from cableway.verification.rollout import verify_rollout

__all__ = ["VerificationLimits", "verify_plan", "verify_rollout"]
