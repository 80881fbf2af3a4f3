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
# A swarm of five agents has to reach a target behind two radars. We plan the path of a single
# agent, let the swarm follow it in formation, and compute how often at least one member arrives.

# %%
# %matplotlib inline
import casswarm as csw
from casswarm.figures import arrival_chart, guide_map, success_chart, swarm_map

scenario = csw.load_scenario("paper-1")
scenario

# %% [markdown]
# ## The guide
#
# The guide is the path of least risk for a single agent. `paper-1` searches from the straight
# line, as the paper does, and finds the gate between the radars. A global search compares paths
# on both sides of every radar and chooses the arrival step. In both cases casswarm proves an
# upper bound on the survival of any single agent.

# %%
guide = csw.plan(scenario)
around = csw.plan(scenario.with_values({"guide.arrival": "any"}), search="global")
print("local: ", guide)
print("global:", around)

# %%
guide_map(scenario, around, around.best_per_homotopy_class())

# %% [markdown]
# Every solution is verified by residuals that are recomputed from the problem, whatever status the
# solver reports:

# %%
print(around.solution)

# %% [markdown]
# ## Policies
#
# Three policies of the paper, and a custom one: a function that maps a batch of B states, with
# positions of shape (B, n, 2), to velocities of the same shape.


# %%
def homing(step, positions, previous_velocities, alive):
    """Fly straight to the target, to arrive on time."""
    remaining = scenario.n_steps - step
    return (scenario.target.center - positions) / (scenario.time.dt * remaining)


policies = ["naive", "constrained", "leader", homing]
study = csw.simulate(scenario, policies, runs=200, guide=guide)
study.summary[["policy", "success", "success_low", "success_high", "infeasible", "saturated"]]

# %%
success_chart(study.summary, scenario.name)

# %% [markdown]
# *infeasible* counts member-steps in which a member could not meet the formation's constraint,
# *saturated* those in which a policy requested more than the limits of speed and acceleration
# allow. The policies share their random numbers, so they are compared run by run, and a
# difference is known more precisely than either success probability:

# %%
study.paired.iloc[:, :5]

# %% [markdown]
# The first run under leader protection: the member on the guide leads, the others close up to it.

# %%
swarm_map(scenario, study.trajectories["leader"][0], guide)

# %% [markdown]
# ## Exact evaluation
#
# Between destructions nothing is random, so the states of the Markov chain can be enumerated.
# Mass that is not enumerated widens the bounds; every probability is a lower and an upper bound:

# %%
distributions = [csw.evaluate(scenario, name, 1e-3, guide=guide) for name in ("naive", "leader")]
for distribution in distributions:
    low, high = distribution.success
    row = study.summary.set_index("policy").loc[distribution.policy]
    print(f"{distribution.policy}: success {low:.4f} to {high:.4f}, {distribution.states} states")
    print(f"  {row['successes']:g} of {row['runs']:g} runs: {row['success']:.3f}")

# %%
arrival_chart(distributions, scenario.name)

# %% [markdown]
# ## Another guide
#
# The same policy along the global guide, around the radars instead of through the gate:

# %%
print(csw.evaluate(scenario, "leader", 1e-3, guide=around))
