from .environments import SwarmEnv, SwarmVectorEnv
from .parallel_env import SwarmParallelEnv

__all__ = ["SwarmEnv", "SwarmParallelEnv", "SwarmVectorEnv"]
