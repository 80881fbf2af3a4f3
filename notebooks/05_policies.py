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
# # Which policy, where no detour is a way out
#
# On the paper's geometry the best thing to do is to go around the radars, and then every policy
# succeeds. What formations are worth shows where every way leads past radars. We take two such
# scenarios: an *alley* of ten radars in two rows, and a *barricade* that cannot be flown around in
# time. `benchmarks/policies.py` does the same for six scenarios and all policies
# (`results/policies`, and the page on policies).

# %%
# %matplotlib inline
import pandas as pd

import casswarm as csw
from casswarm.figures import policy_comparison_chart

POLICIES = ["naive", "constrained", "leader", "leader-mpc-3", "joint"]
scenarios = {name: csw.load_scenario(name) for name in ("alley", "barricade")}

# %% [markdown]
# The head of every law is followed exactly, and what it leaves, `sampled`, by 4000 runs: where that
# is nothing, the interval is a proven bracket, and elsewhere it has 95 % confidence. Beside it
# stands what no policy whatever can exceed, those included that see everything and plan again at
# every step.

# %%
rows = []
for name, scenario in scenarios.items():
    guide = csw.plan(scenario, certify=False)
    bound = csw.success_bound(scenario)
    for policy in POLICIES:
        found = csw.estimate(scenario, policy, 4000, guide=guide)
        rows.append(
            {
                "scenario": name,
                "policy": policy,
                "success_low": found.success[0],
                "success_high": found.success[1],
                "sampled": found.sampled_mass,
                "bound": float(bound),
            }
        )
table = pd.DataFrame(rows)
table.round(4)

# %%
policy_comparison_chart(table)

# %% [markdown]
# **What was learnt.** Leader protection beats flying for oneself, but leaves a lot: it follows a
# guide that was planned for somebody who is alone. The constrained trajectory is short of its
# corridor in most steps, since the guide turns faster than members can, and in the alley that is
# worse than to fly for oneself. To look ahead hardly helps a leader. To plan all members at once
# for the swarm's own success is what pays. And the bound is far from all of them: it lets everybody
# have the protection of all the others all the time, whatever they have to fly through.

# %%
best = table.loc[table.groupby("scenario")["success_low"].idxmax()].set_index("scenario")
best[["policy", "success_low", "bound"]].round(4)
