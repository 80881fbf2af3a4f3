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

import casswarm as cs
from casswarm.figures import rival_chart

POLICIES = ["naive", "constrained", "leader", "leader-ahead-3", "joint"]
scenarios = {name: cs.load_scenario(name) for name in ("alley", "barricade")}

# %% [markdown]
# Nothing is sampled: every success probability is a proven bracket. Beside it stands what no policy
# whatever can exceed, those included that see everything and plan again at every step.

# %%
rows = []
for name, scenario in scenarios.items():
    guide = cs.plan(scenario, certify=False)
    bound = cs.success_bound(scenario)
    for policy in POLICIES:
        law = cs.evaluate(scenario, policy, 1e-2, guide=guide)
        rows.append(
            {
                "scenario": name,
                "policy": policy,
                "success_low": law.success[0],
                "success_high": law.success[1],
                "shortfalls": law.shortfalls,
                "bound": float(bound),
            }
        )
table = pd.DataFrame(rows)
table.round(4)

# %%
rival_chart(table)

# %% [markdown]
# **What was learnt.** The paper's policies beat flying for oneself, but they leave a lot:
# they follow a guide that was planned for somebody who is alone, and the constrained trajectory is
# short of its corridor in most steps, since the guide turns faster than members can. To look ahead
# takes away most shortfalls. To plan all members at once for the swarm's own success is what pays.
# And the bound is far from all of them: it lets everybody have the protection of all the others
# all the time, whatever they have to fly through.

# %%
best = table.loc[table.groupby("scenario")["success_low"].idxmax()].set_index("scenario")
best[["policy", "success_low", "bound"]].round(4)
