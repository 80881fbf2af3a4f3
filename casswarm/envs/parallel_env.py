"""PettingZoo `ParallelEnv` of one swarm, with an agent for every member."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray
from typing_extensions import override

from .._util.extras import require_extra
from ..errors import EnvError
from .environments import RENDERING, OneSwarm

require_extra("rl", "pettingzoo")

from pettingzoo import ParallelEnv  # noqa: E402  (an error of ours comes first)


class SwarmParallelEnv(OneSwarm, ParallelEnv[str, NDArray[Any], NDArray[Any]]):
    """A swarm of agents "member_0", ..., "member_(n-1)", which leave `agents` when destroyed.

    Every agent receives the reward of the swarm until it leaves, in its last step, too. Where news
    are late, an agent leaves when its loss is known. All leave when the run ends. The potential of
    the shaping is 0 after an agent's last step, so that every agent's discounted additions sum to
    -Phi of the initial state.

    Parameters
    ----------
    scenario : Scenario, str or Path
    guide, dtype, shaping, discount, observe_guide, radar_preview, render_mode
        As of `SwarmVectorEnv`.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "name": "casswarm_swarm_v0",
        **RENDERING,
        "is_parallelizable": True,
    }

    @override
    def _set_spaces(self) -> None:
        self.possible_agents = [f"member_{i}" for i in range(self.scenario.n)]
        self.agents: list[str] = []
        self.observation_spaces, self.action_spaces = (
            {agent: _row(space, i) for i, agent in enumerate(self.possible_agents)}
            for space in (self.vector.single_observation_space, self.vector.single_action_space)
        )

    def observation_space(self, agent: str) -> Box:
        """Box (d,) of an agent's observations."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Box:
        """Box (2,) of an agent's velocities."""
        return self.action_spaces[agent]

    def reset(
        self,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002  (of the interface)
    ) -> tuple[dict[str, NDArray[Any]], dict[str, dict[str, Any]]]:
        """Begin run 0 of a seed, or the next run: see `SwarmVectorEnv.reset`."""
        observations, infos = self.vector.reset(seed=seed)
        self.agents = list(self.possible_agents)
        return self._by_agent(observations[0]), self._infos(infos)

    def step(
        self, actions: dict[str, NDArray[Any]]
    ) -> tuple[
        dict[str, NDArray[Any]],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Advance by the velocities (2,) of all agents: see `SwarmVectorEnv.step`.

        Raises
        ------
        EnvError
            The agents of the actions are not those of `agents`; and as `SwarmVectorEnv.step`.
        """
        observations, rewards, terminated, _, infos = self.vector.step(self._velocities(actions))
        agents = self.agents
        believed = self.vector.batch.believed[0]
        ended = {a: bool(terminated[0]) or not believed[self._member(a)] for a in agents}
        result = (
            self._by_agent(observations[0]),
            self._rewards(float(rewards[0]), ended),
            ended,
            dict.fromkeys(agents, False),
            self._infos(infos),
        )
        self.agents = [agent for agent in agents if not ended[agent]]
        return result

    def state(self) -> NDArray[Any]:
        """Observations (n, d) of all members, zeros for the destroyed."""
        return np.asarray(self.vector.batch.observe()[0])

    def _velocities(self, actions: dict[str, NDArray[Any]]) -> NDArray[Any]:
        """The actions as velocities (1, n, 2), zero for the destroyed."""
        if self.agents and set(actions) != set(self.agents):
            raise EnvError(
                f"actions are of {sorted(actions)}; expected one of every living agent, "
                f"{sorted(self.agents)}",
                value=sorted(actions),
                expected=sorted(self.agents),
            )
        velocities = np.zeros((1, self.scenario.n, 2))
        for agent, action in actions.items():
            value = np.asarray(action)
            if value.shape != (2,):
                raise EnvError(
                    f"the action of {agent} has shape {value.shape}; expected (2,)",
                    agent=agent,
                    shape=value.shape,
                    expected=(2,),
                )
            velocities[0, self._member(agent)] = value
        return velocities

    def _rewards(self, reward: float, ended: dict[str, bool]) -> dict[str, float]:
        """The swarm's reward, without the new potential for the agents that leave."""
        batch = self.vector.batch
        last = reward - batch.discount * float(batch.potentials[0])
        return {agent: last if leaves else reward for agent, leaves in ended.items()}

    def _member(self, agent: str) -> int:
        return self.possible_agents.index(agent)

    def _by_agent(self, observations: NDArray[Any]) -> dict[str, NDArray[Any]]:
        every = dict(zip(self.possible_agents, observations, strict=True))
        return {agent: every[agent].copy() for agent in self.agents}

    def _infos(self, infos: dict[str, Any]) -> dict[str, dict[str, Any]]:
        return {
            agent: {
                "run": int(infos["run"][0]),
                "step": int(infos["step"][0]),
                "alive": bool(infos["alive"][0, self._member(agent)]),
                "success": bool(infos["success"][0]),
                "saturated": int(infos["saturated"][0]),
            }
            for agent in self.agents
        }


def _row(space: Any, member: int) -> Box:
    """Space of a member in that of all."""
    return Box(space.low[member], space.high[member], dtype=space.low.dtype.type)
