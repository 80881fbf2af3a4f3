"""Train policies by the exact gradient of their success, and compare them with others.

Run with the installed package::

    python benchmarks/train_policy.py                    # all scenarios of policies.py
    python benchmarks/train_policy.py alley barricade    # some of them, by first word: minutes
    python benchmarks/train_policy.py --quick            # few iterations

The policy sends every member to a waypoint of its own, which depends on the step and on how many
members are lost. At the start of the training all waypoints are those of a formation around the
guide, which closes up unless members collide. Prints a Markdown table; success has proven bounds,
and time is CPU time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from _timing import arguments, print_table, timed
from policies import cases

import casswarm as csw
from casswarm import Guide, ParametricPolicy, Scenario
from casswarm._util.numbers import rounded_up
from casswarm.studies.training import STAGES
from casswarm.typing import FloatArray

CLOSING_STEPS = 3.0
"""Number of steps in which the members' distances to the guide become smaller by a factor of e."""

COLUMNS = ("scenario", "start", "trained", "leader", "joint", "bound", "parameters", "training, s")


@dataclass(frozen=True, eq=False)
class Waypoints:
    """Velocities to waypoints, the sums of those of a reference and of all shifts so far.

    A shift at a step moves all later waypoints, too, as a change of velocity would. That is better
    conditioned than waypoints as parameters: risk depends on many steps of a path alike.

    Parameters
    ----------
    reference : (N+1, n, 2)
        Waypoints without shifts.
    dt : float
    """

    reference: FloatArray
    dt: float

    @property
    def parameters(self) -> int:
        """Number of parameters: a shift of each member for every step and number of losses."""
        steps, n = len(self.reference) - 1, self.reference.shape[1]
        return steps * n * n * 2

    def __call__(
        self, step: int, positions: Any, _previous_velocities: Any, alive: Any, parameters: Any
    ) -> Any:
        """Velocities (n, 2) at a step."""
        n = positions.shape[0]
        shifts = ca.reshape(parameters, 2 * n, n * (len(self.reference) - 1))
        lost = n - ca.sum1(alive)
        shift = ca.MX.zeros(2 * n, 1)
        for k in range(n):
            columns = list(range(k, (step + 1) * n, n))
            shift += (lost == k) * ca.sum2(shifts[:, columns])
        waypoints = ca.DM(self.reference[step + 1]) + ca.reshape(shift, 2, n).T
        return (waypoints - positions) / self.dt


def formation(scenario: Scenario, guide: Guide) -> FloatArray:
    """Waypoints (N+1, n, 2) of members around the guide, who close up if they gather."""
    steps = np.arange(scenario.n_steps + 1)
    path = np.stack([guide.reference(int(step)) for step in steps])
    offsets = scenario.positions - scenario.guide_start
    closing = np.exp(-steps / CLOSING_STEPS) if scenario.hazard.gathers else np.ones(len(steps))
    return path[:, None] + closing[:, None, None] * offsets


def initial_policy(scenario: Scenario, guide: Guide) -> ParametricPolicy:
    """The policy before training."""
    function = Waypoints(formation(scenario, guide), scenario.time.dt)
    return ParametricPolicy(function, np.zeros(function.parameters), scenario, "trained")


def trained(
    scenario: Scenario,
    guide: Guide,
    stages: Sequence[tuple[float, float, int]] = STAGES,
    report: Callable[[str], None] = lambda _: None,
) -> ParametricPolicy:
    """The policy after L-BFGS with the exact gradient, arrivals being smoothed less and less."""
    start = initial_policy(scenario, guide)
    found = csw.train(scenario, start, stages=stages, guide=guide, options={"maxcor": 20})
    for stage, rows in found.history.groupby("stage"):
        best = rows["objective"].max()
        report(f"smoothing {stages[stage][0]:g} radii: {best:.4f} after {len(rows)} gradients")
    return found.policy


def row(name: str, scenario: Scenario, stages: Sequence[tuple[float, float, int]]) -> list[Any]:
    """Measurements in a scenario."""
    guide = csw.plan(scenario)

    def success(policy: Any) -> str:
        low, high = csw.evaluate(scenario, policy, 1e-3, max_states=100_000, guide=guide).success
        return f"{low:.4f} to {high:.4f}"

    training = timed(
        lambda: trained(scenario, guide, stages, lambda line: print(f"  {name}: {line}"))
    )
    policies = (initial_policy(scenario, guide), training.result, "leader", "joint")
    bound = rounded_up(csw.success_bound(scenario).value, 4)
    number = training.result.parameters.size
    return [name, *map(success, policies), f"{bound:.4f}", number, f"{training.cpu:.0f}"]


def main() -> None:
    """Train and print the table."""
    words = {name: name.partition(",")[0] for name in cases()}
    options = arguments(__doc__, dict.fromkeys(words.values()))
    stages = [(0.4, 0.05, 5)] if options.quick else STAGES
    chosen = [(name, s) for name, s in cases().items() if words[name] in options.parts]
    print_table(COLUMNS, [row(name, scenario, stages) for name, scenario in chosen])


if __name__ == "__main__":
    main()
