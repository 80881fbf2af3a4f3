"""One swarm as a `gymnasium.Env` with a single learner, which controls all members."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..planning.guide import Guide
from ..scenario import Scenario
from .rendering import RENDER_FPS, RENDER_MODES
from .vector_env import SwarmVectorEnv


class SwarmEnv(gymnasium.Env[NDArray[Any], NDArray[Any]]):
    """A swarm that one learner controls: `SwarmVectorEnv` with one environment and no autoreset.

    Parameters
    ----------
    scenario : Scenario, str or Path
    guide, dtype, shaping, discount, render_mode
        As of `SwarmVectorEnv`.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]  # a class variable in Gymnasium, too
        "render_modes": list(RENDER_MODES),
        "render_fps": RENDER_FPS,
    }

    def __init__(
        self,
        scenario: Scenario | str | Path,
        *,
        guide: Guide | None = None,
        dtype: Any = "float32",
        shaping: bool = False,
        discount: float = 1.0,
        render_mode: str | None = None,
    ) -> None:
        self.vector = SwarmVectorEnv(
            scenario,
            guide=guide,
            dtype=dtype,
            shaping=shaping,
            discount=discount,
            autoreset_mode="Disabled",
            render_mode=render_mode,
        )
        self.scenario, self.render_mode = self.vector.scenario, render_mode
        self.observation_space = self.vector.single_observation_space
        self.action_space = self.vector.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Begin run 0 of a seed, or the next run: see `SwarmVectorEnv.reset`."""
        super().reset(seed=seed)
        observations, infos = self.vector.reset(seed=seed, options=options)
        return observations[0], _single(infos)

    def step(self, action: ArrayLike) -> tuple[NDArray[Any], float, bool, bool, dict[str, Any]]:
        """Advance by velocities (n, 2): see `SwarmVectorEnv.step`."""
        actions = np.expand_dims(action, 0)
        observations, rewards, terminated, truncated, infos = self.vector.step(actions)
        ends = bool(terminated[0]), bool(truncated[0])
        return observations[0], float(rewards[0]), *ends, _single(infos)

    def render(self) -> NDArray[np.uint8] | None:
        """A picture (height, width, 3); None without a render mode."""
        pictures = self.vector.render()
        return None if pictures is None else pictures[0]


def _single(infos: dict[str, Any]) -> dict[str, Any]:
    """Information on the only environment."""
    return {name: value[0] for name, value in infos.items() if not name.startswith("_")}
