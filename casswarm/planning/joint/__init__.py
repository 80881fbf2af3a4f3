"""Plans of all members at once, for the success of the swarm itself; see ``docs/joint.md``."""

from .optimize import plan_swarm
from .plan import SwarmOutcome, SwarmPlan

__all__ = ["SwarmOutcome", "SwarmPlan", "plan_swarm"]
