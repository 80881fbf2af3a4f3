from .formation import formation_nlp
from .guide import (
    GuideTask,
    guide_instance,
    guide_nlp,
    penalised_guide_instance,
    penalised_guide_nlp,
)
from .joint import JointForm, JointTask, joint_instances, joint_nlp
from .member_sets import subsets

__all__ = [
    "GuideTask",
    "JointForm",
    "JointTask",
    "formation_nlp",
    "guide_instance",
    "guide_nlp",
    "joint_instances",
    "joint_nlp",
    "penalised_guide_instance",
    "penalised_guide_nlp",
    "subsets",
]
