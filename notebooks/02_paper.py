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
# # The paper, step by step
#
# *Cooperative protection control for UCAV swarms in hostile environments* compares three policies
# on two scenarios. We compare its numbers and figures with those that casswarm computes.
# `casswarm reproduce` computes everything in a few minutes and writes it to
# `results/reproduce/`; this notebook shows the quicker parts, with the same functions.

# %%
# %matplotlib inline
import casswarm as csw
from casswarm.figures import convergence_chart, table_2_chart
from casswarm.reproduction import interpretations, reproduce
from casswarm.reproduction.gradient_convergence import (
    condensed,
    formation_convergence,
    guide_convergence,
)
from casswarm.reproduction.reproduce import table_2_text

first, second = csw.load_scenario("paper-1"), csw.load_scenario("paper-2")
paper = reproduce(only=["table-1", "geometry", "table-2", "infeasible", "figures"])

# %% [markdown]
# ## Table I and the geometry
#
# The parameters are the paper's. It shows the positions of radars, target and members only in a
# picture, so the geometry is a calibration (`notebooks/06_calibration.py`), not the paper's figure.

# %%
paper.tables["table-1"]

# %%
paper.tables["geometry"]

# %% [markdown]
# ## Table II
#
# Fifty runs give wide intervals, and the order of constrained and leader depends on the seed. The
# second and third columns are the paper's own method from end to end, with its settings: as many
# runs as in the paper, and success proven or in a 95 % interval. The last is with Ipopt's guide and
# formations solved to optimality: proven, at most 0.001 apart.

# %%
table_2_text(paper.tables["table-2"])

# %%
table_2_chart(paper.tables["table-2"])

# %% [markdown]
# ## Figures 1 to 4
#
# Runs by the paper's method that succeed and lose two members, as in the paper: leader protection,
# constrained trajectory, leader protection with collisions, and the guides of the naive policy.
#
# With collisions the leader's rate alone, which the paper minimises, leaves the directions of the
# followers open. casswarm adds their rates with a weight of 0.01: they keep distances and pass the
# gate together, except for one that the projected gradient leaves behind at the start.

# %%
paper.figures["figure-1"]()

# %%
paper.figures["figure-2"]()

# %%
paper.figures["figure-3"]()

# %%
paper.figures["figure-4"]()

# %% [markdown]
# ## Does the paper's projected gradient converge?
#
# Its steps are steps of displacement, since the paper writes X(t+1) = X(t) + V(t). Steps in
# velocity (light) are dt^2 as long, and need nine times as many iterations. The objective is
# exp(-risk), which is flat where the risk is large. We show the first thousand of its 6000
# iterations, and the formation problems of leader protection.

# %%
guide_path = guide_convergence(first, points=(0, 10, 100, 300, 1000))
formation = formation_convergence(first, "leader", paper.guide, points=(0, 10, 100, 300, 1000))
condensed({"leader, I": formation})

# %%
convergence_chart(
    guide_path, condensed({"leader, I": formation}), {"Ipopt, straight line": paper.guide.survival}
)

# %% [markdown]
# ## Empty constraint sets
#
# The paper does not say what happens where a member cannot meet the constraints of (7). Along
# Ipopt's guide, in 500 runs of the constrained trajectory, nearly all of this occurs in the first
# five steps, in which the members come from their initial positions into the corridor.

# %%
paper.figures["infeasible"]()

# %% [markdown]
# ## Does the order of the policies depend on the guide?
#
# The local guide passes the gate between the radars. A global search finds a guide around it, along
# which all policies almost always succeed: they differ only because they have to pass the gate.

# %%
around = first.with_values({"guide.search": "global", "guide.arrival": "any"})
guide = csw.plan(around, certify=False)
print(guide)
for policy in ("naive", "constrained", "leader"):
    print(csw.evaluate(around, policy, 1e-3, guide=guide))

# %% [markdown]
# ## Errors and ambiguities
#
# What the paper leaves open, and how casswarm interprets it. `docs/paper.md` describes the
# consequences.

# %%
interpretations()[["location", "kind", "paper", "interpretation"]]

# %% [markdown]
# `results/paper/README.md` in the repository shows all of it as one page.
