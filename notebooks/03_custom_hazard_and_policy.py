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
# # A hazard and a policy of your own
#
# The paper's radars are saturated by a dense swarm. Here is another kind of danger: a tower fires
# at a given total rate, and shares its fire among those whom it sees, the nearer the more. Company
# protects, wherever it flies, as long as it is seen. Which formation is best against that?

# %%
# %matplotlib inline
import casadi as ca
import numpy as np

import casswarm as csw
from casswarm.figures import guide_map, success_chart, swarm_map

# %% [markdown]
# ## The hazard
#
# A tower at distance $r$ sees a member by $s = \exp(-r^2 / (2 R^2))$. It fires at member $i$ at the
# rate
#
# $$\lambda_i = f\, s_i \frac{s_i}{c + \sum_{j \text{ alive}} s_j},$$
#
# so at all together at no more than $f$, and at nobody if nobody is near; $c$ keeps the quotient
# regular. As a function of CasADi expressions, positions of shape (n, 2) and alive of shape (n, 1):


# %%
def towers(positions, alive, radars=(), fire=1.5, reach=2.0, calm=0.05):
    """Rates of n members."""
    rates = 0
    for east, north in radars:
        squared = (positions[:, 0] - east) ** 2 + (positions[:, 1] - north) ** 2
        seen = ca.exp(-squared / (2 * reach**2))
        rates += fire * seen**2 / (calm + ca.sum1(alive * seen))
    return rates


# %% [markdown]
# For a proof of how good a guide can be, casswarm asks for lower bounds of a lone member's rate
# over boxes. That rate falls with distance, so the farthest corner will do.


# %%
def least(lower, upper, radars=(), fire=1.5, reach=2.0, calm=0.05):
    """Lower bounds over boxes with corners of shape (..., 2)."""
    rates = 0.0
    for radar in radars:
        farthest = np.maximum(np.abs(lower - radar), np.abs(upper - radar))
        seen = np.exp(-(farthest**2).sum(axis=-1) / (2 * reach**2))
        rates = rates + fire * seen**2 / (calm + seen)
    return rates


towers.single_agent_lower_bound = least

scenario = csw.Scenario.from_data(
    {
        "name": "towers",
        "swarm": {
            "positions": [[0.0, 0.0], [0.3, 0.0], [0.0, 0.3], [0.0, -0.3]],
            "v_max": 1.0,
            "a_max": 0.2,
        },
        "target": {"center": [10.0, 0.0], "radius": 0.5},
        "time": {"dt": 0.5, "t_f": 13.0},
        "hazard": {"kind": towers, "radars": [[4.0, 1.5], [6.0, -1.5]]},
        "guide": {"a_max": 0.1},
    }
)
guide = csw.plan(scenario)
print(guide)

# %%
guide_map(scenario, guide, guide.ways())

# %% [markdown]
# A lone agent has little hope, on either side: both ways are nearly as good.
#
# ## The paper's policies
#
# All of casswarm works with the new rates. *Leader protection* minimises the leader's rate in every
# step. *Naive* members do not look at each other at all.

# %%
study = csw.simulate(scenario, ["naive", "constrained", "leader"], runs=300, guide=guide)
shown = ["policy", "success", "success_low", "success_high", "infeasible"]
study.summary[shown]

# %% [markdown]
# Protecting the leader is the worst that one can do. The picture of a run tells why.

# %%
swarm_map(scenario, study.trajectories["leader"][0], guide)

# %% [markdown]
# The others leave the guide to draw the fire: what protects the leader best in *this* step. They
# are lost one after the other, and then the leader is alone. The problem of a step knows nothing of
# the worth of a protector in the next.
#
# ## Two policies of our own
#
# A policy is a function from a batch of states to velocities. `motion.toward` gives those that
# come nearest to a goal within the limits of speed and acceleration. One policy sends everybody
# along the guide, together; the other sends half of the swarm along the best way on the other side.

# %%
from casswarm.planning.guide import integrate
from casswarm.policies import motion_of

motion = motion_of(scenario)
paths = [integrate(guide.positions[0], way.velocities, guide.dt) for way in guide.ways()[:2]]


def along(path, step, positions, previous_velocities):
    """Velocities (B, m, 2) of m members toward a path's next point."""
    return motion.toward(positions, previous_velocities, path[min(step + 1, len(path) - 1)])


def together(step, positions, previous_velocities, alive):
    """All along the guide."""
    return along(paths[0], step, positions, previous_velocities)


def apart(step, positions, previous_velocities, alive):
    """Half of the members along either way."""
    halves = [slice(0, 2), slice(2, 4)]
    parts = [
        along(path, step, positions[:, half], previous_velocities[:, half])
        for path, half in zip(paths, halves, strict=True)
    ]
    return np.concatenate(parts, axis=1)


own = csw.simulate(scenario, ["leader", "naive", together, apart], runs=300, guide=guide)
success_chart(own.summary, scenario.name)

# %% [markdown]
# The runs share their random numbers, so that policies are compared run by run:

# %%
own.paired.iloc[:, :5]

# %% [markdown]
# No sampling is needed to be sure. The exact laws are brackets, proven:

# %%
laws = [csw.evaluate(scenario, policy, 1e-3, guide=guide) for policy in (together, apart)]
print(*laws, sep="\n")
assert laws[0].success[0] > laws[1].success[1]

# %% [markdown]
# Together is better than apart. Either way leads past a tower that fires at whoever is in sight, at
# one member as much as at four; four share it. Members protect each other by being seen together,
# which naive ones, on guides that nearly coincide, do without knowing.
#
# In a scenario file the hazard would be `kind = "module:towers"`, and on the command line the
# policy `--policy module:together`.
