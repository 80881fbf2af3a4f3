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
# # Hazards that are not known
#
# A wall of radars lacks one of two, and nobody knows which. A single agent cannot find out either:
# it observes only that it lives. This notebook plays the game between the agent, who chooses a
# path, and the hazard, which chooses the missing radar.

# %%
# %matplotlib inline
import numpy as np
import pandas as pd

import casswarm as csw
from casswarm.figures import information_chart, mixture_map

scenario = csw.load_scenario("two-gaps")
[case.weight for case in scenario.cases]

# %% [markdown]
# ## One case at a time
#
# Each case is an ordinary scenario. Who knows the case flies through the gap. The same path in the
# other case flies over a radar.

# %%
guides = [csw.plan(case.scenario, certify=False) for case in scenario.cases]


def survivals(path):
    """Survival along a path in every case."""
    risks = [case.scenario.rates_along(path).sum() for case in scenario.cases]
    return np.exp(-scenario.time.dt * np.array(risks))


table = pd.DataFrame([survivals(guide.positions) for guide in guides])
table.rename_axis("path").add_prefix("case ").round(4)

# %% [markdown]
# ## Drawing the path by lot
#
# A game with this table has no good row: against whoever knows the row, it is worth 0.0001. Drawn
# by lot, each with probability 1/2, the two rows are worth 0.08 in both cases.

# %%
mixed = csw.plan(scenario, ambiguity="worst", gap=0.015)
print(mixed)

# %%
mixture_map(scenario, mixed)

# %% [markdown]
# The upper number is proven for every path and mixture, known or not: against the worst prior no
# path survives with more. Dynamic programming on nodes of a grid *and* beliefs about the cases
# gives it.

# %%
pd.DataFrame(mixed.bound.levels).round(4)

# %% [markdown]
# ## From the mean to the worst case
#
# With a prior of 4 to 1 the agent may trust it, fear the worst, or something between: priors within
# a distance of the given one.

# %%
cases = [case.model_dump(exclude_unset=True) for case in scenario.hazard_table.case]
trusted = scenario.with_values({"hazard.case": [cases[0] | {"weight": 4.0}, cases[1]]})
rows = []
for distance in (0.0, 0.2, 0.4, 0.6, 1.0):
    found = csw.plan(trusted, ambiguity=("tv", distance), gap=0.03)
    rows.append({"distance": distance} | found.value._asdict() | {"pure": found.pure_value})
pd.DataFrame(rows).round(4)

# %% [markdown]
# ## A cloud of nine cases
#
# One radar is at one of nine places. The worst prior puts its weight on four of them.

# %%
cloud = csw.load_scenario("cloud")
scattered = csw.plan(cloud, ambiguity="worst")
mixture_map(cloud, scattered)

# %%
scattered.worst_prior.round(3)

# %% [markdown]
# ## A swarm
#
# Members act by the prior means of the rates. Their law is that of every case, and the mean of
# these for the prior.

# %%
law = csw.evaluate(scenario, "leader", 1e-2)
print(law)

# %% [markdown]
# A joint plan maximises the success for the prior; a mixture of plans that of the worst one. For
# two of the members:

# %%
pair = scenario.with_values({"swarm.positions": scenario.positions[:2].tolist()})
print(csw.plan_swarm(pair, certify=False))

# %%
mixed_plan = csw.plan_swarm_mixture(pair, "worst", certify=False)
print(mixed_plan)
mixture_map(pair, mixed_plan)

# %% [markdown]
# ## What is it worth to know?
#
# Losses tell something about the case: a swarm may act by its posterior given who has survived
# (`formation.belief = "bayes"`). Here that comes too late to turn to the other gap. Who knows the
# case before the start succeeds more often than any plan for the prior.

# %%
table = csw.value_of_information(scenario, ["leader", "constrained"], tolerance=0.02)
information_chart(table, "two-gaps")

# %%
table.round(3)
