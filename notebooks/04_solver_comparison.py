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
# Which solver is the fastest, which is the most reliable, and does it do what it says? We let
# solvers answer the questions that planning and simulation ask: the guide of a lone agent, and the
# formation of a swarm at one step. Every solver runs in a process of its own, so that one that
# crashes or hangs is a row of the table and not the end of the study.

# %%
# %matplotlib inline
import casswarm as csw
from casswarm.comparison.profiles import (
    data_profile,
    pairwise_profiles,
    pairwise_wins,
    performance_profile,
    share_at,
)
from casswarm.comparison.report import make_report
from casswarm.comparison.verification import by_problem, costs, failures
from casswarm.figures import pair_chart, profile_chart, win_chart
from casswarm.optimization.solvers import Ipopt, ProjectedGradient

# %% [markdown]
# A small family, and four solvers. A mapping gives labels, so that one solver can take part with
# different options. `casswarm compare` runs the large families, with `folder=` a study that is
# stopped goes on where it was.

# %%
solvers = {
    "ipopt": "ipopt",
    "ipopt-bfgs": Ipopt(hessian="limited-memory"),
    "spectral": "spectral",
    "projected-gradient": ProjectedGradient(max_iter=500),
}
comparison = csw.compare(["quick"], solvers, problems=2, seconds=10)
comparison.summary

# %% [markdown]
# **Solved** means that the solver says so *and* that it is true: violation, stationarity and
# complementarity are computed again from the problem, for all solvers alike, and held against
# stated tolerances. **Found** means that the objective is also the best known, within a tolerance.
# The two can differ, for some of these problems have several minima: here a guide.

# %%
comparison.tolerances

# %% [markdown]
# The four counts of the summary are a solver's word against the truth. *said_not_true* are its
# false claims; *true_not_said* are problems that it solved without noticing. Here nobody claims
# what is false. What was not solved has a reason; to the paper's projected gradient with a constant
# step it happens most:

# %%
failures(comparison.cells)

# %% [markdown]
# A row a problem: who was the fastest, and how far apart the answers are.

# %%
by_problem(comparison.cells)

# %% [markdown]
# ## Performance profiles
#
# Let $r_{p,s}$ be the time of solver $s$ on problem $p$ divided by that of the fastest solver on
# $p$, infinite where it failed. The profile of $s$ is the share of problems with
# $r_{p,s} \le \tau$ (Dolan and Moré, *Math. Program.* 91, 2002). At $\tau = 1$ it tells how often
# $s$ is the fastest, and for large $\tau$ how often it solves a problem at all: speed on the left,
# reliability on the right. Scaling all times changes nothing. Here the compiled solver is the
# fastest on nearly every problem, and Ipopt as reliable, later: read both ends.

# %%
times = costs(comparison.cells, "formations", "cold", "solve_seconds")
found = costs(comparison.cells, "formations", "cold", "solve_seconds", "found")
profile = performance_profile(times)
profile_chart(
    {"solved": profile, "and the best known objective": performance_profile(found)},
    "factor of the fastest solver's time",
    "formations, cold start",
)

# %%
share_at(profile, 100.0)  # within a factor of 100 of the fastest

# %% [markdown]
# ## Pairs
#
# In a profile of many solvers only the best curve can be read against the others: the order of the
# rest can change when a solver is taken out (Gould and Scott, *ACM Trans. Math. Software* 43,
# 2016), since it also changes who the fastest is. Two solvers are compared by their own profile.

# %%
pair_chart(pairwise_profiles(times), "formations, cold start")

# %%
win_chart(pairwise_wins(times), "formations, cold start")

# %% [markdown]
# ## Data profiles
#
# How many problems are solved within a budget, whoever else takes part (after Moré and Wild,
# *SIAM J. Optim.* 20, 2009). Their unit is the cost of a simplex gradient; with derivatives we
# count evaluations. Fewer evaluations need not mean less time: Ipopt does much linear algebra in
# each iteration, and a projected gradient next to none.

# %%
evaluations = costs(comparison.cells, "formations", "cold", "evaluations")
profile_chart({"formations, cold start": data_profile(evaluations)}, "evaluations")

# %% [markdown]
# ## A report
#
# All of this, for every family and kind of start, as Markdown or one HTML page for somebody who was
# not there.

# %%
report = make_report(comparison)
print(report.markdown()[:600])
