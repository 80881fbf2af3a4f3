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
# # How well can any policy do?
#
# A policy that succeeds in half of its runs may be poor, or the best there is. This notebook
# builds an upper bound on the success of *every* policy, from one member to five: of policies
# that observe everything, have memory and randomise. In the alley, nobody can avoid the ten
# radars.

# %%
# %matplotlib inline
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import casswarm as csw
from casswarm.bounds import PotentialFamily
from casswarm.bounds.level_game import LevelGame
from casswarm.figures import cost_to_go_map
from casswarm.grid import Relaxation
from casswarm.scenario.variations import with_parameters

alley = csw.load_scenario("alley")
swarms = {n: with_parameters(alley, {"n": n}) for n in range(1, 6)}

# %% [markdown]
# ## One member: the risk that is left
#
# A single agent survives with the probability exp(-risk), so that the best policy is a path.
# Dynamic programming on a grid gives the least risk that is left from every position, the
# *cost-to-go*, and proves how well any path can do from the start.

# %%
guide = csw.plan(alley)
guide.survival, guide.survival_bound

# %%
cost_to_go_map(alley, csw.ValueFunction.from_scenario(alley), guide)

# %% [markdown]
# ## More members: independent clocks
#
# The others reduce a member's rate, at most by the factor that all of them have when they are
# near. If every member had this protection to the end, it would survive its path with a
# probability of at most exp(-least risk), whatever it does, and the members would be lost
# independently. Success is at most the probability that not all are lost. The bound is proven,
# but too optimistic: those who are lost do not protect any more.

# %%
clocks = {n: csw.success_bound(swarm, max_work=0.0) for n, swarm in swarms.items()}
print(clocks[5])

# %% [markdown]
# ## Levels
#
# Call the least risk of a single agent that is left to a member its *level*. Members start with
# high levels, and have to bring them down to zero. A drop of the level costs at least as much
# risk as it is large, less what the others protect; and it can be bounded, by counting steps
# through the most dangerous places as if they cost no more than some *largest drop*. What remains
# of the geometry is a game: in each step a player chooses how far every living member drops, and
# each survives independently with a probability that depends on its drop, on the number of the
# living, and on how far behind they are.

# %%
family = PotentialFamily(Relaxation.from_scenario(swarms[2]), swarms[2].positions, 200_000)
level = float(family.potential().start_levels.mean())
potential = family.potential(slope=4 * level / 10, largest=0.15 * level)
game = LevelGame(potential, cells=8, players=(0, 1))
axis = np.linspace(0.0, 1.1 * level, 60)
values = np.array([[game.at(np.array([one, two])) for two in axis] for one in axis])
print(
    f"levels at the start: {potential.start_levels.round(3)}; value of the game: {game.value():.4f}"
)

# %%
fig, (left, right) = plt.subplots(1, 2, figsize=(9.5, 4), layout="constrained")
low = potential.task.start + potential.spacing * np.array(potential.low)
high = low + potential.spacing * (np.array(potential.values[0].shape) - 1)
image = left.imshow(
    np.minimum(potential.values[0].T, 2 * level),
    extent=(low[0], high[0], low[1], high[1]),
    origin="lower",
    cmap="viridis_r",
)
left.plot(*np.array(alley.hazard_table.radars).T, "^", color="white", mec="black", label="radar")
left.plot(*swarms[2].positions.T, "o", color="#d55e00", label="member")
left.set(title="level at step 0", xlabel="x", ylabel="y")
left.legend(loc="upper left", fontsize="small")
fig.colorbar(image, ax=left, shrink=0.8)
contours = right.contourf(axis, axis, np.minimum(values, 1.0), 20, cmap="viridis")
right.plot(*[potential.start_levels[[k]] for k in (0, 1)], "o", color="#d55e00")
right.annotate(
    "start", potential.start_levels, (-30, -12), textcoords="offset points", color="white"
)
right.set(
    title="bound on success of two members", xlabel="level of one", ylabel="level of the other"
)
right.set_aspect("equal")
_ = fig.colorbar(contours, ax=right, shrink=0.8)

# %% [markdown]
# The value of the game, computed from low levels to high ones, is at least the success of every
# policy: the value never increases on average, whatever is chosen. Interpolation between levels
# and rounding are part of the proof (the page on the upper bound). Along the diagonal the members
# drop together; away from it one arrives alone, without protection, and the other hardly matters.
#
# ## From one member to five
#
# The bounds, and the exact success of two policies: leader protection, and all paths planned
# together for the swarm's own success.

# %%
rows = []
for n, swarm in swarms.items():
    path = csw.plan(swarm, certify=False)
    laws = {name: csw.evaluate(swarm, name, 2e-3, guide=path) for name in ("leader", "joint")}
    rows.append(
        {"members": n}
        | {name: law.success.low for name, law in laws.items()}
        | {"level game": float(csw.success_bound(swarm)), "clocks": float(clocks[n])}
    )
table = pd.DataFrame(rows).set_index("members")
table.round(4)

# %%
fig, axes = plt.subplots(figsize=(5.5, 3.6), layout="constrained")
axes.fill_between(table.index, table["joint"], table["level game"], color="#bbbbbb", alpha=0.5)
for name, style in zip(table.columns, ("o-", "s-", "^--", "v:"), strict=True):
    axes.plot(table.index, table[name], style, label=name)
axes.annotate("the best policy is here", (3.4, 0.52), fontsize="small")
axes.set(xlabel="members", ylabel="success", xticks=table.index, ylim=(0, 1))
_ = axes.legend()

# %% [markdown]
# ## Two members: the optimum between two bounds
#
# For two members dynamic programming over both positions is possible. `optimal_value` brackets
# the success of the best policy; its lower end is the exact success of a policy, `optimal`. So we
# see how much of the distance above is due to the bound, and how much to the policy.

# %%
barricade = with_parameters(csw.load_scenario("barricade"), {"n": 2})
print(csw.optimal_value(barricade))
print(csw.success_bound(barricade))
print("joint:", csw.evaluate(barricade, "joint").success)
