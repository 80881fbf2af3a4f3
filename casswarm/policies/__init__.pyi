from .base import Policy
from .decision import Decision
from .feedback import ConstrainedFeedbackPolicy, LeaderFeedbackPolicy
from .formation import ConstrainedPolicy, LeaderPolicy
from .leader_selection import LEADER_SELECTION
from .observation import Observation
from .optimal import OptimalPolicy
from .parametric import ParametricPolicy
from .planned_paths import JointPolicy, NaivePolicy, ReplanningPolicy
from .registry import POLICIES, make_policy, member_guides
from .user import UserPolicy, as_policy

__all__ = [
    "LEADER_SELECTION",
    "POLICIES",
    "ConstrainedFeedbackPolicy",
    "ConstrainedPolicy",
    "Decision",
    "JointPolicy",
    "LeaderFeedbackPolicy",
    "LeaderPolicy",
    "NaivePolicy",
    "Observation",
    "OptimalPolicy",
    "ParametricPolicy",
    "Policy",
    "ReplanningPolicy",
    "UserPolicy",
    "as_policy",
    "make_policy",
    "member_guides",
]
