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
# # A comparison of solvers as a study
#
# ## Question
#
# Planning poses guides, and simulation poses formations, to an optimisation solver. Which of four
# solvers is the fastest on such problems, which is the most reliable, and how sure is that? This is
# a small study that runs within a minute; `docs/solver-comparison.md` is the large one.

# %%
# %matplotlib inline
import casswarm as csw
from casswarm.comparison.profiles import fraction_at, pairwise_profiles, performance_profile
from casswarm.comparison.report import make_report
from casswarm.comparison.verification import by_problem, costs, failures
from casswarm.figures import pair_chart
from casswarm.formation import ProjectedGradient
from casswarm.solvers import Ipopt

# %% [markdown]
# ## Set-up
#
# Two problems of each of five kinds, from random scenarios of seed 0, each from a cold and a warm
# start. Every solver runs in a process of its own, so a crash or a hang is a row of the table and
# does not end the study. A mapping gives labels, so one solver can take part with different
# options.

# %%
solvers = {
    "ipopt": "ipopt",
    "ipopt-bfgs": Ipopt(hessian="limited-memory"),
    "spectral": "spectral",
    "projected-gradient": ProjectedGradient(max_iter=500),
}
comparison = csw.compare(["quick"], solvers, count=2, time_limit=10)
comparison

# %% [markdown]
# A problem counts as **solved** if the solver reports a success *and* this is verified: violation,
# stationarity and complementarity are recomputed from the problem, in the same way for all solvers,
# and compared with these tolerances. **Best known** means that the objective is also the best known
# one. The two can differ, because some of these problems have several minima: here a guide.

# %%
comparison.tolerances

# %% [markdown]
# ## Result
#
# The report has the answer in words, tables and figures; `comparison.ranking` and
# `comparison.summary` are its main tables. Ranks are those of the shifted geometric mean of the
# solve time, in which failures count as the time limit. Intervals and probabilities come from
# resampling the problems; below eight problems, as for the guides here, there are none.

# %%
report = make_report(comparison)
print(report.markdown().split("## Set-up")[0].split("## Answer")[1].split("|")[0])

# %%
report.figures["ranking-formations-cold"]()

# %% [markdown]
# The performance profile of solver $s$ is the fraction of problems that it solves within a factor
# $\tau$ of the fastest solver's time (Dolan and Moré, *Math. Program.* 91, 2002): speed on the
# left, reliability on the right. The bands are 95 % confidence bands, pointwise: where the curve of
# all problems of this kind is expected. With eight problems they are wide.

# %%
report.figures["bands-formations-cold"]()

# %% [markdown]
# One of the two compiled solvers, `spectral` and `projected-gradient`, is the fastest on nearly
# every problem; Ipopt is as reliable as `spectral`, but slower. The end of the profiles in numbers:

# %%
times = costs(comparison.runs, "formations", "cold", "solve_seconds")
profile = performance_profile(times)
fraction_at(profile, 100.0)  # within a factor of 100 of the fastest

# %% [markdown]
# In a profile of many solvers only the best curve can be compared with the others: the order of the
# other curves can change when a solver is removed (Gould and Scott, *ACM Trans. Math. Software* 43,
# 2016), because removing it also changes which solver is the fastest. Two solvers are compared by a
# profile of their own.

# %%
pair_chart(pairwise_profiles(times), "formations, cold start")

# %% [markdown]
# How the solvers approach the best known objective of a problem. Infeasible iterates are hollow,
# and solvers that report no iterates are named.

# %%
comparison.convergence("constrained-3-saturation-0").plot()

# %% [markdown]
# Every failure has a reason; most are those of the paper's projected gradient method with a
# constant step. There are no false positives, that is, no success that was reported and not
# verified.

# %%
failures(comparison.runs)

# %%
by_problem(comparison.runs)

# %% [markdown]
# ## What would change the result
#
# The first solver by other criteria, and the rank there of the solver that is the first by mean
# solve time:

# %%
report.tables["sensitivity"]

# %% [markdown]
# Times also change from run to run. `comparison.save(folder)` saves a comparison,
# `csw.Comparison.load(folder)` reads it, and `first.agreement(second)` says whether each ranks the
# solvers within the other's error bars. Not varied here: the machine, the versions, other options
# of the solvers, and the kind of problems.
