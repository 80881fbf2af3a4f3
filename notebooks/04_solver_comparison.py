# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Comparing solvers
#
# Which solver is the fastest, which is the most reliable, and is its reported status correct? We
# compare solvers on the problems that planning and simulation pose: the guide of a single agent,
# and the formation of a swarm at one step. Every solver runs in a process of its own, so a crash
# or a hang is a row of the table and does not end the study.

# %%
# %matplotlib inline
from dataclasses import dataclass

import casswarm as csw
from casswarm.comparison.profiles import (
    data_profile,
    fraction_at,
    pairwise_profiles,
    pairwise_wins,
    performance_profile,
)
from casswarm.comparison.report import make_report
from casswarm.comparison.verification import by_problem, costs, failures
from casswarm.figures import pair_chart, profile_chart, win_chart
from casswarm.optimization.solvers import Ipopt, ProjectedGradient

# %% [markdown]
# A small family and four solvers. A mapping gives labels, so that one solver can take part with
# different options. `casswarm compare` runs the large families; with a results folder, an
# interrupted study can be resumed.

# %%
solvers = {
    "ipopt": "ipopt",
    "ipopt-bfgs": Ipopt(hessian="limited-memory"),
    "spectral": "spectral",
    "projected-gradient": ProjectedGradient(max_iter=500),
}
comparison = csw.compare(["quick"], solvers, count=2, time_limit=10)
comparison.summary

# %% [markdown]
# **Solved** means that the solver reports success *and* that this is verified: violation,
# stationarity and complementarity are recomputed from the problem, in the same way for all
# solvers, and compared with the tolerances below. **Best known** means that the objective is also
# the best known one, within a tolerance. The two can differ, because some of these problems have
# several minima: here a guide.

# %%
comparison.tolerances

# %% [markdown]
# Four counts of the summary compare the reported with the verified status: false positives are
# reported as solved and are not, missed ones are solved and not reported. Here there are no false
# positives. Every failure has a reason; most are those of the paper's projected gradient method
# with a constant step:

# %%
failures(comparison.runs)

# %% [markdown]
# One row per problem: the fastest solver, and how far the objectives differ.

# %%
by_problem(comparison.runs)

# %% [markdown]
# ## Performance profiles
#
# Let $r_{p,s}$ be the time of solver $s$ on problem $p$ divided by that of the fastest solver on
# $p$, infinite where it failed. The profile of $s$ is the fraction of problems with $r_{p,s} \le
# \tau$ (Dolan and Moré, *Math. Program.* 91, 2002). At $\tau = 1$ it shows how often $s$ is the
# fastest, and for large $\tau$ how often it solves a problem at all: speed on the left,
# reliability on the right. The profile does not depend on the unit of time. Here one of the two
# compiled solvers, `spectral` and `projected-gradient`, is the fastest on nearly every problem;
# Ipopt is as reliable as `spectral` but slower.

# %%
times = costs(comparison.runs, "formations", "cold", "solve_seconds")
best = costs(comparison.runs, "formations", "cold", "solve_seconds", "best_known")
profile = performance_profile(times)
profile_chart(
    {"solved": profile, "and the best known objective": performance_profile(best)},
    "factor of the fastest solver's time",
    "formations, cold start",
)

# %%
fraction_at(profile, 100.0)  # within a factor of 100 of the fastest

# %% [markdown]
# ## Pairs
#
# In a profile of many solvers only the best curve can be compared with the others: the order of the
# other curves can change when a solver is removed (Gould and Scott, *ACM Trans. Math. Software* 43,
# 2016), because removing it also changes which solver is the fastest. Two solvers are compared by a
# profile of their own.

# %%
pair_chart(pairwise_profiles(times), "formations, cold start")

# %%
win_chart(pairwise_wins(times), "formations, cold start")

# %% [markdown]
# ## Data profiles
#
# The fraction of problems solved within a budget, independent of the other solvers (after Moré
# and Wild, *SIAM J. Optim.* 20, 2009). Their unit is the cost of a simplex gradient; with
# derivatives we count evaluations. Fewer evaluations need not take less time: Ipopt does much
# linear algebra in each iteration, a projected gradient method hardly any.

# %%
evaluations = costs(comparison.runs, "formations", "cold", "evaluations")
profile_chart({"formations, cold start": data_profile(evaluations)}, "evaluations")

# %% [markdown]
# ## Problems of one's own
#
# The formation problems of two scenarios, a solver that is defined here, and a profile. Problems of
# CasADi, Opti and AMPL's `.nl` files are compared in the same way: see
# `docs/own-problems.md`.


# %%
@dataclass(frozen=True)
class Hasty(Ipopt):
    tolerance: float = 1e-4
    name = "hasty"


problems = [
    problem
    for name in ("ring", "wall")
    for problem in csw.formation_problems(csw.load_scenario(name), count=2)
]
own = csw.compare(problems, ["ipopt", "slsqp", "projected-gradient", Hasty()], time_limit=10)
own.plot()

# %%
own.profile("wall formations", "warm")

# %% [markdown]
# ## A report
#
# All of this, for every family and kind of start, as Markdown or as one self-contained HTML page.

# %%
report = make_report(comparison)
print(report.markdown()[:600])
