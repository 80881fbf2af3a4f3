"""Policies: what every member does, from the state of the swarm."""

from .base import Decision, Policy, UserPolicy, as_policy
from .feedback import ConstrainedFeedbackPolicy, LeaderFeedbackPolicy
from .formation import ConstrainedPolicy, LeaderPolicy
from .independent import NaivePolicy
from .joint import JointPolicy
from .joint_feedback import JointFeedbackPolicy
from .leader_selection import SUCCESSIONS
from .mpc import ConstrainedAheadPolicy, LeaderAheadPolicy
from .registry import POLICIES, make_policy, member_guides

__all__ = [
    "POLICIES",
    "SUCCESSIONS",
    "ConstrainedAheadPolicy",
    "ConstrainedFeedbackPolicy",
    "ConstrainedPolicy",
    "Decision",
    "JointFeedbackPolicy",
    "JointPolicy",
    "LeaderAheadPolicy",
    "LeaderFeedbackPolicy",
    "LeaderPolicy",
    "NaivePolicy",
    "Policy",
    "UserPolicy",
    "as_policy",
    "make_policy",
    "member_guides",
]
