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
# # News that is late
#
# The paper lets every member know every loss at once. With `information.delay` losses are known
# some steps later, or never. Until then a lost member is a *ghost*: the others decide as if it
# were alive. This notebook shows what that costs, exactly, and for whom.

# %%
# %matplotlib inline
import pandas as pd

import casswarm as csw
from casswarm.figures import formation_chart, swarm_map
from casswarm.scenario.variations import with_parameters

gauntlet = csw.load_scenario("gauntlet")
late = gauntlet.replace(information={"delay": 8})

# %% [markdown]
# ## A ghost leads
#
# `leader` keeps the formation around the member that is nearest to the guide. Where news come
# eight steps late, the others protect a lost leader for eight steps more. Hollow marks are ghosts;
# dashed lines are where the others believe them to be.

# %%
study = csw.simulate(late, ["leader"], runs=1, seed=3)
(run,) = study.trajectories["leader"]
formation_chart(late, run, study.guide)

# %%
swarm_map(late, run, study.guide)

# %% [markdown]
# ## The exact law
#
# The state of the chain holds the ghosts' positions and how late their losses are. States are
# enumerated as without delay; there are more of them, since it matters when a member was lost.

# %%
guide = csw.plan(gauntlet, certify=False)
delays = (0, 1, "never")
rows = []
for delay in delays:
    scenario = gauntlet.replace(information={"delay": delay})
    for policy in ("leader", "constrained"):
        law = csw.evaluate(scenario, policy, 1e-2, guide=guide)
        rows.append(
            {"delay": delay, "policy": policy, "states": law.states} | law.success._asdict()
        )
pd.DataFrame(rows).round(4)

# %% [markdown]
# `constrained` hardly needs the news: all members stay near the guide, whoever is lost. `leader`
# depends on them. A given policy need not lose by late news. In `alley`, `constrained` even gains,
# since ghosts keep the living apart from each other:

# %%
alley = csw.load_scenario("alley")
for delay in (0, "never"):
    scenario = alley.replace(information={"delay": delay})
    print(delay, csw.evaluate(scenario, "constrained", 2e-3).success)

# %% [markdown]
# ## The price of late news
#
# Of *optimal* policies success cannot rise with the delay, since who knows more can ignore it. With
# two members both ends are proven: nothing is random until the first loss, so that a plan for both
# and plans for the survivor are a policy, whose law with the delay is the lower end. The upper end
# is of policies that know losses at once. So the price of a delay, the success that it costs the
# best policy, is at most the upper end less the lower one.

# %%
two = with_parameters(gauntlet, {"n": 2})
values = {
    delay: csw.optimal_value(two, time_limit=2.0, delay=delay).success for delay in (0, 2, "never")
}
table = pd.DataFrame(values, index=["low", "high"]).T
table.assign(price_at_most=table.high.min() - table.low).round(5)

# %% [markdown]
# ## Planning with what is known
#
# `joint` is a plan that looks at nothing: its law is the same for every delay. `joint-replanning`
# makes a new plan when a loss becomes known. All that is known then is who was alive `delay` steps
# before. The plan for these members is optimised, and compared with the present one, from that
# step on, with the steps that were flown since then fixed; so whoever may be lost by now counts
# with the probability of being alive. So replanning is never worse than the plan, however late the
# news are.

# %%
three = with_parameters(alley, {"n": 3})
plan = csw.plan_swarm(three)
print(f"joint          {plan.success.low:.6f}")
for delay in (0, 4):
    scenario = three.replace(information={"delay": delay})
    law = csw.evaluate(scenario, "joint-replanning", 1e-5, aggregation_tol=0.0)
    print(f"delay {delay}        {law.success.low:.6f} to {law.success.high:.6f}")
