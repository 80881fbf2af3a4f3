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
# # A first study
#
# A swarm of five agents has to reach a target behind two radars. We plan the path of a lone agent,
# let the swarm follow it in formation, and ask how often some member arrives alive.

# %%
# %matplotlib inline
import casswarm as csw
from casswarm.figures import arrival_chart, guide_map, success_chart, swarm_map

scenario = csw.load_scenario("paper-1")
scenario

# %% [markdown]
# ## The guide
#
# The least risky path of a lone agent. `paper-1` searches from the straight line, as the paper
# does, and finds the gate between the radars. A global search compares ways around both sides of
# every radar and chooses the arrival step. Beside either stands what is proven: how likely any lone
# agent can survive at the best.

# %%
guide = csw.plan(scenario)
around = csw.plan(scenario.with_values({"guide.arrival": "any"}), search="global")
print("local: ", guide)
print("global:", around)

# %%
guide_map(scenario, around, around.ways())

# %% [markdown]
# Every solve is judged by residuals that are computed anew from the problem, whatever the solver
# says of itself:

# %%
print(around.solution)

# %% [markdown]
# ## Policies
#
# Three policies of the paper, and one of our own: a function from a batch of B states, positions of
# shape (B, n, 2), to velocities of the same shape.


# %%
def homing(step, positions, previous_velocities, alive):
    """Everybody straight to the target, to be there on time."""
    remaining = scenario.n_steps - step
    return (scenario.target.center - positions) / (scenario.time.dt * remaining)


policies = ["naive", "constrained", "leader", homing]
study = csw.simulate(scenario, policies, runs=200, guide=guide)
study.summary[["policy", "success", "success_low", "success_high", "infeasible", "saturated"]]

# %%
success_chart(study.summary, scenario.name)

# %% [markdown]
# *Shortfalls* are member-steps in which a member could not be where the formation wants it,
# *clipped* those in which a policy asked for more than the limits of speed and acceleration allow.
# Policies share their random numbers, so that a difference is taken run by run, and is known better
# than either success by itself:

# %%
study.paired.iloc[:, :5]

# %% [markdown]
# The first run under leader protection: the member on the guide leads, the others close up to it.

# %%
swarm_map(scenario, study.trajectories["leader"][0], guide)

# %% [markdown]
# ## Without sampling
#
# Between destructions nothing is random, so the law of the chain can be followed exactly. What is
# not followed to its end is a mass, and every probability a bracket:

# %%
laws = [csw.evaluate(scenario, policy, 1e-3, guide=guide) for policy in ("naive", "leader")]
for law in laws:
    low, high = law.success
    row = study.summary.set_index("policy").loc[law.policy]
    print(f"{law.policy}: success between {low:.4f} and {high:.4f}, by {law.states} solves")
    print(f"  {row['successes']:g} of {row['runs']:g} runs: {row['success']:.3f}")

# %%
arrival_chart(laws, scenario.name)

# %% [markdown]
# ## With another guide
#
# The same policy along the global guide, around the radars instead of through the gate:

# %%
print(csw.evaluate(scenario, "leader", 1e-3, guide=around))
