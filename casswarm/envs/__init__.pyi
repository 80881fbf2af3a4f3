from .parallel_env import SwarmParallelEnv
from .swarm_env import SwarmEnv
from .vector_env import SwarmVectorEnv

__all__ = ["SwarmEnv", "SwarmParallelEnv", "SwarmVectorEnv"]
