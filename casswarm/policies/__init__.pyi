from .base import Decision, Policy
from .formation_policies import (
    ConstrainedFeedbackPolicy,
    ConstrainedPolicy,
    LeaderFeedbackPolicy,
    LeaderPolicy,
    applied_decision,
)
from .named import POLICIES, make_policy, member_guides
from .observation import Observation, ObservedState
from .parametric import ParametricPolicy
from .planned_paths import JointPolicy, NaivePolicy, OptimalPolicy, ReplanningPolicy
from .user import UserPolicy, as_policy, repeated

__all__ = [
    "POLICIES",
    "ConstrainedFeedbackPolicy",
    "ConstrainedPolicy",
    "Decision",
    "JointPolicy",
    "LeaderFeedbackPolicy",
    "LeaderPolicy",
    "NaivePolicy",
    "Observation",
    "ObservedState",
    "OptimalPolicy",
    "ParametricPolicy",
    "Policy",
    "ReplanningPolicy",
    "UserPolicy",
    "applied_decision",
    "as_policy",
    "make_policy",
    "member_guides",
    "repeated",
]
