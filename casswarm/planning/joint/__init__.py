"""Plans of all members at once, for the success of the swarm itself; see ``docs/joint.md``."""

from .plan import SwarmOutcome, SwarmPlan
from .optimize import plan_swarm

__all__ = ["SwarmOutcome", "SwarmPlan", "plan_swarm"]
