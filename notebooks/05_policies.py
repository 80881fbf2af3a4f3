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
# # Radars that cannot be avoided
#
# On the paper's geometry it is best to fly around the radars, and then every policy succeeds.
# Policies differ where every path passes radars. We compare them in two such scenarios: an
# *alley* of ten radars in two rows, and a *barricade* that is too wide to fly around in time.
# `benchmarks/policies.py` compares all policies in six scenarios (`results/policies`, and the
# page on policies).

# %%
# %matplotlib inline
import pandas as pd

import casswarm as csw
from casswarm.figures import success_chart

POLICIES = ["naive", "constrained", "leader", "leader-mpc-3", "joint"]
scenarios = {name: csw.load_scenario(name) for name in ("alley", "barricade")}

# %% [markdown]
# The most probable states are enumerated exactly, and the remaining mass, `sampled`, is estimated
# from 4000 runs: where it is zero, the interval consists of proven bounds; elsewhere it is a 95 %
# confidence interval. `bound` is an upper bound on the success of every policy, including those
# that observe everything and replan at every step.

# %%
rows = []
for name, scenario in scenarios.items():
    guide = csw.plan(scenario, certify=False)
    bound = csw.success_bound(scenario)
    for policy in POLICIES:
        estimate = csw.estimate(scenario, policy, 4000, tolerance=1e-4, guide=guide)
        rows.append(
            {
                "scenario": name,
                "policy": policy,
                "success_low": estimate.success.low,
                "success_high": estimate.success.high,
                "sampled": estimate.sampled_mass,
                "bound": float(bound),
            }
        )
table = pd.DataFrame(rows)
table.round(4)

# %%
success_chart(table)

# %% [markdown]
# **Findings.** Leader protection is better than independent flight, but far from the best: it
# follows a guide that was planned for a single agent. Under the constrained trajectory, members
# miss the corridor in most steps, since the guide turns faster than they can; in the alley this
# is worse than independent flight. A longer horizon hardly helps a leader. Planning all members
# at once for the swarm's own success helps most. How the upper bound is built, and how much of the
# distance to it is its own, is the subject of the notebook on bounds.

# %%
best = table.loc[table.groupby("scenario")["success_low"].idxmax()].set_index("scenario")
best[["policy", "success_low", "bound"]].round(4)
