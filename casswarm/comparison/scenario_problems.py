"""Problems of one's own scenario: those that planning and simulating it poses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .._util.seeds import require_seed
from ..errors import ComparisonError
from ..optimization.problem import Instances, Nlp
from ..optimization.solvers import Auto, Ipopt
from ..planning.plan import plan, plan_from
from ..policies import Policy
from ..scenario import Scenario
from ..studies.policy_list import policy_list, policy_name
from ..studies.simulation import simulate
from ..typing import FloatArray
from .problem import Problem
from .recorder import Recorder, formation_starts, guide_starts

COUNT = 3
"""Default number of guides, and of states for every policy."""

WITHOUT_FORMATIONS = ("naive", "joint", "joint-replanning")
"""Policies that follow planned paths, and pose no problem while they run."""

RUNS = 20
"""Simulated runs that the states come from."""


def guide_problems(scenario: Scenario, count: int = COUNT, seed: int = 0) -> list[Problem]:
    """Problems that planning the scenario's guide poses: solves spread over its search.

    Their cold start is the search's own, and their warm start the answer with noise added.

    Parameters
    ----------
    scenario : Scenario
    count : int
        The largest number of problems; a local search has a single one.
    seed : int
        Of the noise.

    Returns
    -------
    list of Problem
        Of the family "NAME guides".

    Raises
    ------
    ComparisonError
        A count below one, or no problem had anything to optimise.
    PlanningError
        No guide was found.
    """
    rng = np.random.default_rng([require_seed(seed), 3])
    recorder = Recorder(Ipopt())
    plan_from(scenario, scenario.guide_start, recorder)
    name = f"{scenario.name} guide"
    return [
        Problem(
            f"{name} {number}",
            f"{name}s",
            nlp,
            guide_starts(instances, x, rng),
            {"scenario": scenario.name},
        )
        for number, (nlp, instances, x) in enumerate(_spread(recorder, count, rng, name))
    ]


def formation_problems(
    scenario: Scenario,
    policies: str | Policy | Sequence[str | Policy] = ("leader", "constrained"),
    count: int = COUNT,
    *,
    seed: int = 0,
    runs: int = RUNS,
) -> list[Problem]:
    """Formation problems of states that simulated runs of the scenario reach.

    Their cold start is zero velocities, as in the paper, and their warm start the velocities of the
    previous step, projected onto the feasible set.

    Parameters
    ----------
    scenario : Scenario
    policies : str, Policy, or sequence of these
        Names such as leader, constrained and leader-mpc-3.
    count : int
        The largest number of states for every policy, of steps that are spread over the runs.
    seed : int
        Of the runs, and of the choice among their states.
    runs : int
        Number of simulated runs.

    Returns
    -------
    list of Problem
        Of the family "NAME formations".

    Raises
    ------
    ComparisonError
        A count below one, a lone agent, or a policy that poses no problem to a solver, such as
        naive or joint.
    PlanningError
        No guide was found.
    PolicyError
        An unknown policy.
    """
    rng = np.random.default_rng([require_seed(seed), 4])
    listed = policy_list(policies)
    _require_formations(scenario, listed)
    guide = plan(scenario, check=False)
    problems = []
    for policy in listed:
        recorder, name = Recorder(Auto()), policy_name(policy)
        simulate(scenario, [policy], runs, seed, guide=guide, solver=recorder, save_trajectories=0)
        for number, (nlp, instances, _) in enumerate(
            _spread(recorder, count, rng, f"policy {name!r}")
        ):
            problems.append(
                Problem(
                    f"{scenario.name} {name} {number}",
                    f"{scenario.name} formations",
                    nlp,
                    formation_starts(nlp, instances),
                    {"scenario": scenario.name, "members": scenario.n, "policy": name},
                )
            )
    return problems


def _require_formations(scenario: Scenario, policies: Sequence[str | Policy]) -> None:
    if scenario.n < 2:
        raise ComparisonError(
            f"scenario {scenario.name!r} has a single member, which is in no formation; "
            "guide_problems poses its guide"
        )
    for policy in policies:
        if policy in WITHOUT_FORMATIONS:
            raise ComparisonError(
                f"policy {policy!r} poses no formation problem: its members follow paths that are "
                "planned before; choose leader, constrained, leader-mpc-H or constrained-mpc-H"
            )


def _spread(
    recorder: Recorder, count: int, rng: np.random.Generator, what: str
) -> list[tuple[Nlp, Instances, FloatArray]]:
    """Single instances with free variables, of recorded solves that are spread over all."""
    if count < 1:
        raise ComparisonError(f"count = {count}; allowed: whole numbers from 1")
    records = []
    for nlp, instances, x in recorder.records:
        free = np.flatnonzero((instances.lbx < instances.ubx).any(axis=1))
        if len(free):
            records.append((nlp, instances, x, free))
    if not records:
        raise ComparisonError(f"{what}: no problem was posed to a solver, or none with a choice")
    chosen = np.unique(np.linspace(0, len(records) - 1, count + 2)[1:-1].round().astype(int))
    singles = []
    for nlp, instances, x, free in (records[i] for i in chosen):
        row = slice(at := int(rng.choice(free)), at + 1)
        singles.append((nlp, instances[row], x[row]))
    return singles
