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
# # Quick start
#
# A swarm of five agents has to reach a target behind two radars. We plan the path of a lone agent,
# let the swarm follow it in formation, and ask how often some member arrives alive.

# %%
# %matplotlib inline
import casswarm as cs
from casswarm.figures import guide_map, success_chart, swarm_map

scenario = cs.load_scenario("paper-1")
print(scenario.description)

# %% [markdown]
# ## The guide
#
# The least risky path of a lone agent. `paper-1` searches from the straight line, as the paper
# does, and finds the gate between the radars. A global search compares ways around both sides of
# every radar and chooses the arrival step.

# %%
guide = cs.plan(scenario)
around = cs.plan(scenario.with_values({"guide.arrival": "any"}), search="global")
print(guide, around, sep="\n")
print(around.solution)

# %%
guide_map(scenario, around, around.ways())

# %% [markdown]
# ## Policies
#
# Three policies of the paper, and one of our own: a function from a batch of states, positions of
# shape (B, n, 2), to velocities of the same shape.


# %%
def homing(step, positions, previous, alive):
    """Everybody straight to the target, to be there on time."""
    remaining = scenario.n_steps - step
    return (scenario.target.center - positions) / (scenario.time.dt * remaining)


study = cs.simulate(scenario, ["naive", "constrained", "leader", homing], runs=200, guide=guide)
study.summary

# %%
success_chart(study.summary, scenario.name)

# %% [markdown]
# The first run under leader protection: the member on the guide leads, the others close up to it.

# %%
swarm_map(scenario, study.traces["leader"][0], guide)
