"""Environments for learning: many swarms as one vector environment, or a single swarm."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar, TypeAlias

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray
from typing_extensions import override

from .._util.figure_style import BLUE, add_legend, add_title, marker, themed
from .._util.numbers import MAX_SEED, require_seed
from .._util.text import shown
from ..errors import EnvError
from ..figures.maps import add_start, base_map
from ..guide.guide import Guide
from ..scenario import Scenario
from ..typing import BoolArray, FloatArray
from .batch import SwarmBatch

RENDERING: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 5}
"""Metadata of all environments."""


def frame(
    scenario: Scenario, step: int, positions: FloatArray, alive: BoolArray, believed: BoolArray
) -> NDArray[np.uint8]:
    """Picture (height, width, 3) of living members and ghosts at a step, on the hazard's map."""
    canvas = FigureCanvasAgg(_figure(scenario, step, positions, alive, believed))
    canvas.draw()  # type: ignore[no-untyped-call]
    pixels = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
    return pixels[..., :3].copy()


@themed
def _figure(
    scenario: Scenario, step: int, positions: FloatArray, alive: BoolArray, believed: BoolArray
) -> Figure:
    fig, axes = base_map(scenario, [scenario.positions], step)
    add_start(axes, scenario.positions)
    axes.plot(*positions[alive].T, zorder=6, label="living", **marker("o", 6, BLUE))
    if (believed & ~alive).any():
        ghosts = positions[believed & ~alive]
        axes.plot(*ghosts.T, zorder=6, label="ghosts", **marker("o", 6, "none", BLUE))
    add_legend(axes)
    add_title(axes, f"{scenario.name}: step {step} of {scenario.n_steps}, {alive.sum()} alive")
    return fig


Infos: TypeAlias = dict[str, Any]


class SwarmVectorEnv(VectorEnv[NDArray[Any], NDArray[Any], NDArray[Any]]):
    """B swarms of a scenario, controlled by one learner each; see ``docs/envs.md``.

    A run ends (`terminated`) with the first arrival of a living member, the last destruction, or
    at the horizon, which is part of the model; nothing is `truncated`. In environment k the runs
    k, k + B, k + 2 B, ... of a seed follow each other; run k sees the random numbers of run k of
    `casswarm.simulate`.

    Parameters
    ----------
    scenario : Scenario, str or Path
        Or a built-in name, or the path of a scenario file.
    num_envs : int
        B.
    guide : Guide, optional
        Whose first velocity is V(-1), where the scenario says so, and which may be observed;
        planned by default.
    dtype : str
        Of observations: float32 or float64.
    shaping : bool
        Whether rewards are shaped by potentials, see `casswarm.envs.batch`.
    discount : float
        Of the shaping; that of the learner.
    observe_guide : bool
        Whether members observe the guide's reference of the next step: see `Observation`.
    radar_preview : int
        Number of next steps whose radars are observed, too, where radars move or switch.
    autoreset_mode : AutoresetMode or str
        When a run that has ended is followed by the next: see `step` for ``DISABLED``.
    render_mode : str, optional
        "rgb_array" or None.

    Raises
    ------
    EnvError
        Invalid arguments; and in `step`, runs that have ended, and actions that are not finite or
        of the wrong shape.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]  # instances have their own
        **RENDERING,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        scenario: Scenario | str | Path,
        num_envs: int = 1,
        *,
        guide: Guide | None = None,
        dtype: Any = "float32",
        shaping: bool = False,
        discount: float = 1.0,
        observe_guide: bool = False,
        radar_preview: int = 0,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
    ) -> None:
        if render_mode not in (None, *RENDERING["render_modes"]):
            raise EnvError(
                f"render_mode = {shown(render_mode)}; allowed: None, 'rgb_array'",
                render_mode=render_mode,
            )
        self.autoreset_mode = _mode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}  # type: ignore[misc]
        observed = observe_guide, radar_preview
        self.batch = SwarmBatch(scenario, num_envs, guide, dtype, shaping, discount, *observed)
        self.scenario, self.num_envs = self.batch.scenario, self.batch.size
        self.render_mode = render_mode
        observation = self.batch.observation
        low, high = observation.bounds()
        self.single_observation_space = Box(low, high, dtype=low.dtype.type)
        limit = low.dtype.type(observation.v_max)
        shape = observation.n, 2
        self.single_action_space = Box(-limit, limit, shape, low.dtype.type)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._seeded = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], Infos]:
        """Begin a new run in all environments, or in those of ``options["reset_mask"]``.

        Parameters
        ----------
        seed : int, optional
            From 0 to 2^64 - 1: environment k begins with its run k. Without one, the next runs of
            the present seed follow; a first seed is drawn at random.
        options : dict, optional
            ``reset_mask`` (B,) bool.

        Returns
        -------
        observations : (B, n, d)
        infos : dict
        """
        rows = _reset_mask(options, self.num_envs)
        if seed is not None:
            seed = require_seed(seed)
            super().reset(seed=seed)
        elif not self._seeded:
            seed = int(self.np_random.integers(MAX_SEED, dtype=np.uint64, endpoint=True))
        if seed is not None:
            self.batch.seed(seed, np.ones_like(rows) if not self._seeded else rows)
            self._seeded = True
        self.batch.begin(rows)
        return self.batch.observe(), self._infos(rows)

    def step(
        self, actions: ArrayLike
    ) -> tuple[NDArray[Any], FloatArray, BoolArray, BoolArray, Infos]:
        """Advance by velocities (B, n, 2), which are projected on what v_max and a_max allow.

        With ``AutoresetMode.DISABLED``, runs that have ended stay as they are while others go on:
        their actions are ignored, their rewards are 0, they remain `terminated`, and the masks of
        `infos` are False for them. When all have ended, `reset` must be called.

        Returns
        -------
        observations : (B, n, d)
        rewards : (B,)
        terminated, truncated : (B,) bool
        infos : dict
        """
        batch, every = self.batch, np.ones(self.num_envs, bool)
        resets, frozen = ~every, ~every
        if self.autoreset_mode is AutoresetMode.NEXT_STEP and self._seeded:
            resets = batch.ends.ended.copy()
        elif self.autoreset_mode is AutoresetMode.DISABLED and not batch.ends.ended.all():
            frozen = batch.ends.ended & (batch.swarms.steps > 0)  # the others have not begun
        rewards = batch.step(actions, ~(resets | frozen))
        ended = batch.ends.ended & ~resets
        final: Infos = {}
        if self.autoreset_mode is AutoresetMode.SAME_STEP and ended.any():
            final, resets = _final(ended, batch.observe(), self._infos(every)), ended
        if resets.any():
            batch.begin(resets)
        infos = self._infos(~frozen) | final
        return batch.observe(), rewards, ended, np.zeros_like(ended), infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """A picture (height, width, 3) of every environment; None without a render mode."""
        if self.render_mode is None:
            return None
        swarms = self.batch.swarms
        parts = swarms.steps.tolist(), swarms.positions, swarms.alive, self.batch.believed
        return tuple(frame(self.scenario, *state) for state in zip(*parts, strict=True))

    def _infos(self, rows: BoolArray) -> Infos:
        """Information on environments, each array with a mask of those that it is about."""
        swarms, ends = self.batch.swarms, self.batch.ends
        values = {
            "run": swarms.runs.astype(np.int64),
            "step": swarms.steps.copy(),
            "alive": swarms.alive.copy(),
            "survivors": ends.survivors.copy(),
            "success": ends.success.copy(),
            "saturated": self.batch.moves.saturated.copy(),
        }
        if len(self.scenario.cases) > 1:
            values["case"] = self.batch.cases.copy()
        return values | {f"_{name}": rows.copy() for name in values}


def _final(ended: BoolArray, observations: NDArray[Any], infos: Infos) -> Infos:
    """Last observations and information of the runs that ended, as Gymnasium passes them."""
    rows = np.flatnonzero(ended)
    final = np.full(len(ended), None, object)
    final[rows] = np.fromiter(observations[rows], object, len(rows))
    masks = {name: ended.copy() for name in infos if name.startswith("_")}
    return {
        "final_obs": final,
        "_final_obs": ended.copy(),
        "final_info": infos | masks,
        "_final_info": ended.copy(),
    }


def _mode(mode: AutoresetMode | str) -> AutoresetMode:
    modes = {key: m for m in AutoresetMode for key in (m, m.value, m.name)}
    if mode not in modes:
        allowed = ", ".join(repr(m.value) for m in AutoresetMode)
        raise EnvError(f"autoreset_mode = {shown(mode)}; allowed: {allowed}", autoreset_mode=mode)
    return modes[mode]


def _reset_mask(options: dict[str, Any] | None, size: int) -> BoolArray:
    mask = (options or {}).get("reset_mask")
    if mask is None:
        return np.ones(size, bool)
    rows = np.asarray(mask)
    if rows.shape != (size,) or rows.dtype != bool or not rows.any():
        raise EnvError(
            f"options['reset_mask'] has shape {rows.shape} and dtype {rows.dtype}; expected "
            f"({size},) booleans, at least one of them True",
            shape=rows.shape,
            dtype=rows.dtype,
            expected=(size,),
        )
    return rows


class OneSwarm:
    """The only environment of a `SwarmVectorEnv` without autoreset."""

    def __init__(
        self,
        scenario: Scenario | str | Path,
        *,
        guide: Guide | None = None,
        dtype: Any = "float32",
        shaping: bool = False,
        discount: float = 1.0,
        observe_guide: bool = False,
        radar_preview: int = 0,
        render_mode: str | None = None,
    ) -> None:
        self.vector = SwarmVectorEnv(
            scenario,
            guide=guide,
            dtype=dtype,
            shaping=shaping,
            discount=discount,
            observe_guide=observe_guide,
            radar_preview=radar_preview,
            autoreset_mode="Disabled",
            render_mode=render_mode,
        )
        self.scenario, self.render_mode = self.vector.scenario, render_mode
        self._set_spaces()

    def _set_spaces(self) -> None:
        """Define the spaces of observations and actions."""
        raise NotImplementedError

    def render(self) -> NDArray[np.uint8] | None:
        """A picture (height, width, 3); None without a render mode."""
        pictures = self.vector.render()
        return None if pictures is None else pictures[0]


class SwarmEnv(OneSwarm, gymnasium.Env[NDArray[Any], NDArray[Any]]):
    """A swarm that one learner controls: `SwarmVectorEnv` with one environment and no autoreset.

    Parameters
    ----------
    scenario : Scenario, str or Path
    guide, dtype, shaping, discount, observe_guide, radar_preview, render_mode
        As of `SwarmVectorEnv`.
    """

    metadata: ClassVar[dict[str, Any]] = {**RENDERING}  # type: ignore[misc]  # as in Gymnasium

    @override
    def _set_spaces(self) -> None:
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


def _single(infos: dict[str, Any]) -> dict[str, Any]:
    """Information on the only environment."""
    return {name: value[0] for name, value in infos.items() if not name.startswith("_")}
