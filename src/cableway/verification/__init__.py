"""Independent judgement of plans and rollouts.

Nothing here shares code with what makes a plan: clearance is measured with Shapely on dense polylines, and the rod
that must follow a plan is solved in link angles instead of centre coordinates.
"""

from cableway.core.deprecation import renamed
from cableway.verification.plan import VerificationLimits, verify_insertion_plan, verify_plan
from cableway.verification.plug import Inserted, measure_insertion
from cableway.verification.record import kind_of, require_verified, verify_record
from cableway.verification.rollout import verify_insertion, verify_rollout

__all__ = [
    "Inserted",
    "VerificationLimits",
    "kind_of",
    "measure_insertion",
    "require_verified",
    "verify_insertion",
    "verify_insertion_plan",
    "verify_plan",
    "verify_record",
    "verify_rollout",
]


__getattr__ = renamed(__name__, {"verify_push": "verify_insertion_plan"})
