"""Swarms of a scenario that advance together, each in a run of its own.

Rewards can be shaped by a potential, from the certified risk to go.

With w_t(x) the lower bound of the risk to go of a single agent (`casswarm.bounds`), the
potential of a state is the probability that one of the living would arrive if each were alone and
met that risk:

    Phi(t, X, alive) = 1 - prod over living i of (1 - exp(-w_t(X_i))),    0 where the run has ended.

A step's reward becomes r + gamma Phi' - Phi. The sum of the discounted additions over a run is
-Phi(initial state), whatever the actions are, so that no optimal policy changes: Ng, Harada and
Russell, "Policy invariance under reward transformations: theory and application to reward shaping",
ICML 1999, theorem 1.
"""

from __future__ import annotations

from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._util.numbers import SPEED_TOL, require_seed
from .._util.text import shown
from ..bounds import PotentialFamily
from ..chain.monte_carlo import STEP_BITS, Purpose, drawn_cases, write_uniforms
from ..chain.transition import SATURATION_TOL
from ..compiled.kernels import contiguous
from ..errors import EnvError
from ..grid import Relaxation
from ..guide.agent import initial_velocities
from ..guide.guide import Guide
from ..guide.plan import plan
from ..hazard import Hazard
from ..hazard.compiled_rates import CompiledRates, compiled_rates
from ..motion.planar_kernels import WIDTH
from ..motion.step import Motion
from ..policies.observation import Observation
from ..scenario import Scenario, load_scenario
from ..scenario.variations import require_default
from ..typing import BoolArray, FloatArray, IntArray
from . import step_kernels
from .step_kernels import RiskTable

MAX_NODES = 250_000
"""Largest number of nodes of the table over all steps: 2 MB, which caches hold."""


@lru_cache(maxsize=16)
def risk_table(scenario: Scenario) -> RiskTable:
    """Table of the risk to go of a scenario whose hazard has bounds of its rates."""
    scenario = scenario.believed  # any potential leaves the best policies as they are
    task = Relaxation.from_scenario(scenario)
    if not task.bounded:
        raise EnvError(
            f"shaping needs a hazard with lower bounds of its rates, which "
            f"{type(scenario.hazard).__name__} does not provide; Saturation and "
            "SaturationCollision do: use shaping=False",
            hazard=type(scenario.hazard).__name__,
        )
    potential = PotentialFamily(task, scenario.positions, MAX_NODES).potential()
    east, north = np.asarray(task.start) + potential.spacing * np.array(potential.low)
    return RiskTable(
        values=np.stack(potential.values),
        east=float(east),
        north=float(north),
        spacing=float(potential.spacing),
        slack=float(potential.slack),
    )


class SwarmBatch:
    """B swarms with random numbers of their own.

    The run k of a seed sees the random numbers of the run k of `casswarm.simulate` with this seed.
    Parameters are those of `SwarmVectorEnv`. `swarms` are the states, `moves` and `ends` how they
    moved last, and how their last step ended; `potentials` (B,) are those of the states, zeros
    without shaping; `cases` (B,) the true cases of a hazard that is not known, drawn by the prior.
    """

    def __init__(
        self,
        scenario: Scenario | str | Path,
        size: int,
        guide: Guide | None,
        dtype: Any,
        shaping: bool,
        discount: float,
        observe_guide: bool = False,
        radar_preview: int = 0,
    ) -> None:
        if not isinstance(size, int | np.integer) or size < 1:
            raise EnvError(
                f"num_envs = {shown(size)}; allowed: whole numbers from 1",
                key="num_envs",
                value=size,
            )
        if not 0 < discount <= 1:
            raise EnvError(
                f"discount = {shown(discount)}; allowed: above 0 and at most 1",
                key="discount",
                value=discount,
            )
        self.scenario = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
        for key in ("time.substeps", "target.other"):
            require_default(self.scenario, key, "casswarm.envs")
        self.size, self.discount = int(size), discount
        if guide is None and observe_guide:
            guide = plan(self.scenario.believed, certify=False)
        observed = guide if observe_guide else None
        self.observation = Observation.from_scenario(
            self.scenario, dtype, guide=observed, preview=radar_preview
        )
        self._initial_velocities = _initial_velocities(self.scenario, guide)
        self._table = risk_table(self.scenario) if shaping else None
        n, shape = self.scenario.n, (self.size, self.scenario.n, 2)
        self.swarms = step_kernels.Swarms(
            positions=np.zeros(shape),
            velocities=np.zeros(shape),
            alive=np.zeros(shape[:2], bool),
            late=np.zeros(shape[:2], np.int64),
            steps=np.zeros(self.size, np.int64),
            seeds=np.zeros(self.size, np.uint64),
            runs=np.zeros(self.size, np.uint64),
        )
        counts = np.zeros((2, self.size), np.int64)
        self.moves = step_kernels.Moves(
            positions=np.zeros(shape),
            velocities=np.zeros(shape),
            rates=np.zeros(shape[:2]),
            saturated=counts[0],
        )
        self.ends = step_kernels.Ends(
            success=np.zeros(self.size, bool), ended=np.ones(self.size, bool), survivors=counts[1]
        )
        self.potentials: FloatArray = np.zeros(self.size)
        self.cases: IntArray = np.zeros(self.size, np.int64)
        self._work = np.empty((1, WIDTH)), np.empty(n)

    @cached_property
    def _rates(self) -> list[tuple[Hazard, CompiledRates | None]]:
        """The hazard of every case, and its compiled rates if it has any."""
        hazards = [case.scenario.hazard for case in self.scenario.cases]
        return [(hazard, compiled_rates(hazard, self.scenario.n)) for hazard in hazards]

    @cached_property
    def _limits(self) -> step_kernels.Limits:
        motion, target = Motion.from_scenario(self.scenario), self.scenario.target
        return step_kernels.Limits(
            motion.limits,
            motion.v_max,
            SPEED_TOL,
            SATURATION_TOL,
            motion.dt,
            *target.center,
            target.radius,
            self.scenario.success.arrivals,
            self.scenario.swarm.counting,
            self.scenario.n_steps,
            self.scenario.n_steps if self.scenario.delay is None else self.scenario.delay,
        )

    def seed(self, seed: int, rows: BoolArray) -> None:
        """Let swarm k of the given ones begin with the run k of a seed, at its next `begin`."""
        self.swarms.seeds[rows] = np.uint64(require_seed(seed))
        # `begin` adds the number of swarms
        self.swarms.runs[rows] = np.flatnonzero(rows).astype(np.uint64) - np.uint64(self.size)

    def begin(self, rows: BoolArray) -> None:
        """Begin the next run in the given swarms (B,): B runs after the present one."""
        swarms, which = self.swarms, np.flatnonzero(rows)
        swarms.runs[which] += np.uint64(self.size)
        swarms.positions[which] = self.scenario.positions
        swarms.velocities[which] = self._initial_velocities
        swarms.alive[which], swarms.late[which], swarms.steps[which] = True, 0, 0
        self.ends.success[which], self.ends.ended[which] = False, False
        self.ends.survivors[which], self.moves.saturated[which] = self.scenario.n, 0
        if len(self.scenario.cases) > 1:
            self.cases[which] = drawn_cases(self.scenario, self._case_draws(which))
        self._write_potentials()

    def _case_draws(self, which: IntArray) -> FloatArray:
        """Uniform numbers that draw the true cases of runs, as in a simulation."""
        draws, key = np.empty((len(which), 1)), np.uint64(Purpose.CASES << STEP_BITS)
        for draw, seed, run in zip(
            draws, self.swarms.seeds[which], self.swarms.runs[which], strict=True
        ):
            write_uniforms(seed, key, run, draw)
        return draws[:, 0]

    @property
    def believed(self) -> BoolArray:
        """Members (B, n) that are not known to be lost: the living, and ghosts."""
        return self.swarms.alive | (self.swarms.late > 0)

    def observe(self) -> NDArray[Any]:
        """Observations (B, n, d), a new array."""
        swarms = self.swarms
        return self.observation(swarms.steps, swarms.positions, swarms.velocities, self.believed)

    def step(self, actions: ArrayLike, active: BoolArray) -> FloatArray:
        """Advance the active swarms (B,) by velocities (B, n, 2); return the rewards (B,).

        Raises
        ------
        EnvError
            A run that has ended, or actions of the wrong shape, or not finite for a living member;
            no swarm has moved then.
        HazardError
            Rates that are negative or not finite.
        """
        self._require_running(active)
        velocities = self._checked(actions)
        swarms, moves, limits = self.swarms, self.moves, self._limits
        sets, draws = self._work
        first = step_kernels.move(velocities, active, swarms, limits, sets, moves)
        if first >= 0:
            raise self._not_finite(velocities, *divmod(first, self.scenario.n))
        self._write_rates(active)
        step_kernels.advance(active, swarms, moves, limits, draws, self.ends)
        rewards = (self.ends.success & active).astype(np.float64)
        if self._table is not None:
            before = self.potentials.copy()
            self._write_potentials()
            rewards[active] += (self.discount * self.potentials - before)[active]
        return rewards

    def _write_potentials(self) -> None:
        if self._table is not None:
            swarms = self.swarms
            state = swarms.steps, swarms.positions, swarms.alive, self.ends.ended
            step_kernels.write_potentials(self._table, *state, self.potentials)

    def _write_rates(self, active: BoolArray) -> None:
        """Write the rates where the active swarms move."""
        for case in range(len(self._rates)):
            self._write_rates_of(case, active & (self.cases == case))

    def _write_rates_of(self, case: int, active: BoolArray) -> None:
        """Write the rates of a case of the hazard."""
        moves, swarms, (hazard, compiled) = self.moves, self.swarms, self._rates[case]
        if not hazard.changes:
            alone = len(self._rates) == 1
            rates = moves.rates if alone else np.empty_like(moves.rates)
            if compiled is None or not compiled(moves.positions, swarms.alive, rates):
                # these rates are checked
                rates[active] = hazard.rates(moves.positions[active], swarms.alive[active])
            if not alone:
                moves.rates[active] = rates[active]
            return
        for step in np.unique(swarms.steps[active]):
            rows = active & (swarms.steps == step)
            positions, alive = moves.positions[rows], swarms.alive[rows]
            moves.rates[rows] = hazard.after(int(step) + 1).rates(positions, alive)

    def _require_running(self, active: BoolArray) -> None:
        over = np.flatnonzero(self.ends.ended & active)
        if over.size:
            which = ", ".join(map(str, over[:5])) + (", ..." if over.size > 5 else "")
            raise EnvError(
                f"step after the end, or before the first reset, of {over.size} of {self.size} "
                f"runs (environment {which}): call reset, for some of several environments with "
                "options={'reset_mask': mask}",
                environments=over,
            )

    def _checked(self, actions: ArrayLike) -> FloatArray:
        """The actions as an array (B, n, 2)."""
        shape = self.swarms.positions.shape
        try:
            velocities = np.asarray(actions, float)
        except (TypeError, ValueError):
            raise EnvError(
                f"actions are an object of type {type(actions).__name__}; expected an array of "
                f"velocities {shape}: (environments, members, 2)",
                value=type(actions).__name__,
                expected=shape,
            ) from None
        if velocities.shape != shape:
            raise EnvError(
                f"actions have shape {velocities.shape}; expected {shape}: "
                "(environments, members, 2)",
                shape=velocities.shape,
                expected=shape,
            )
        return contiguous(velocities)

    def _not_finite(self, velocities: FloatArray, state: int, member: int) -> EnvError:
        velocity = velocities[state, member]
        return EnvError(
            f"the action of member {member} in environment {state} is {velocity}; velocities of "
            "living members must be finite",
            environment=state,
            member=member,
            action=velocity,
        )


def _initial_velocities(scenario: Scenario, guide: Guide | None) -> FloatArray:
    if scenario.swarm.velocity != "guide":
        return np.tile(np.asarray(scenario.swarm.velocity, float), (scenario.n, 1))
    return initial_velocities(scenario, guide or plan(scenario.believed, certify=False))
