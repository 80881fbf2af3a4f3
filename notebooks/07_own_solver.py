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
# # An own solver in a comparison
#
# Ipopt, SLSQP, the paper's projected gradient method and a solver that is defined here, on the
# formation problems of two scenarios. `Hasty` is Ipopt with a loose tolerance: a class in a cell
# can take part like any other, in a process of its own.

# %%
# %matplotlib inline
from dataclasses import dataclass

import casswarm as csw


@dataclass(frozen=True)
class Hasty(csw.solvers.Ipopt):
    tolerance: float = 1e-3
    name = "hasty"


scenarios = [csw.load_scenario(name) for name in ("ring", "wall")]
problems = [p for s in scenarios for p in csw.formation_problems(s, count=4)]
solvers = ["ipopt", "slsqp", "projected-gradient", Hasty()]
comparison = csw.compare(problems, solvers, time_limit=10)

# %% [markdown]
# Performance profiles: at 1, how often a solver is the fastest; at the right end, how often it
# solves a problem at all, which is verified by residuals recomputed from the problem.

# %%
comparison.plot()

# %% [markdown]
# The ranks by mean time, in which failures count as the time limit, with 95 % intervals and
# probabilities from resampling the problems:

# %%
comparison.ranking

# %% [markdown]
# The hasty solver reports a success on every problem, as Ipopt does, but many of its answers do not
# pass the verification: they are counted as false positives.

# %%
comparison.summary.groupby("solver", sort=False)[["true_positives", "false_positives"]].sum()

# %% [markdown]
# How the solvers approach the best known objective of a problem:

# %%
comparison.convergence("wall constrained 0").plot()
