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
# # Calibration: a geometry for the paper's scenarios
#
# The paper shows the positions of radars, target and members only in a picture. This script
# searches for positions with which the paper's own method (guide, formations and naive guides by
# projected gradient, with the settings of Table I) gives the success probabilities of Table II,
# and keeps them under small changes. The parameters of Table I are never changed. The result is a
# calibration, not the paper's figure.
#
# By default the script assesses the geometry of `paper-1` and two others under a few small
# changes, in about a minute. With `CASSWARM_CALIBRATION=500` in the environment, or the number
# as the argument of the script, it first searches that many random candidates, about a second
# each, and assesses the best under all changes.

# %%
import os
import sys

import numpy as np
import pandas as pd

import casswarm as csw
from casswarm.reproduction import PAPER_SUCCESS
from casswarm.reproduction.paper_tables import (
    geometry_changes,
    paper_interval,
    table_2_of_reading,
    table_2_with_ipopt,
)

N_CANDIDATES = int(os.environ.get("CASSWARM_CALIBRATION", "0"))
if __name__ == "__main__" and sys.argv[1:] and sys.argv[1].isdigit():
    N_CANDIDATES = int(sys.argv[1])
SEARCH_RUNS, RUNS = 200, 1000  # per policy, while searching and for an assessment

{name: paper_interval(name) for name in PAPER_SUCCESS}

# %% [markdown]
# ## Candidates
#
# Five members in a cross, or in a square with one at its centre, around the origin; a target; and
# two radars on both sides of the straight line to it, less than ten units from the start.

# %%
PATTERNS = {
    "cross": np.array([[0, 0], [1, 0], [0, 1], [-1, 0], [0, -1]], float),
    "square": np.array([[0, 0], [1, 1], [-1, 1], [-1, -1], [1, -1]], float),
}


def geometry(target, radars, pattern, spacing):
    """Scenario values of a geometry."""
    return {
        "target.center": list(target),
        "hazard.radars": [list(radar) for radar in radars],
        "swarm.positions": np.round(spacing * PATTERNS[pattern], 2).tolist(),
    }


def random_geometry(rng):
    """Scenario values of a random geometry, to one decimal."""
    angle, length = rng.uniform(0, np.pi / 2), rng.uniform(8, 18)
    ahead = np.array([np.cos(angle), np.sin(angle)])
    across = angle + np.pi / 2 + 0.6 * rng.normal()
    aside = rng.uniform(0.5, 1.1) * np.array([np.cos(across), np.sin(across)])
    gate = rng.uniform(1.5, 8) * ahead + 0.3 * rng.normal(size=2)
    return geometry(
        np.round(length * ahead, 1).tolist(),
        np.round([gate + aside, gate - aside], 1).tolist(),
        str(rng.choice(list(PATTERNS))),
        float(rng.choice([0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8])),
    )


# %% [markdown]
# ## Assessment
#
# The *deviation* of a candidate is the largest distance of a success probability from the paper's,
# over the three policies, in units of the half-width of the 95 % interval of its 50 runs on that
# side: 1 is the end of the interval; 9 if the guide does not arrive. A guide is *direct* if it
# never moves backwards from the start by more than 0.1, along the straight line to the target, and
# takes nearly all of the time.


# %%
def deviation(row):
    """Largest distance from the paper's numbers, in half-widths of its intervals."""
    if row["guide_survival"] == 0:
        return 9.0
    worst = 0.0
    for name, paper in PAPER_SUCCESS.items():
        end = paper_interval(name)[int(row[name] > paper)]
        worst = max(worst, (row[name] - paper) / (end - paper))
    return worst


def is_direct(scenario, guide):
    """Whether a guide goes ahead from the start, and takes nearly all of the time."""
    ahead = scenario.target.center / np.hypot(*scenario.target.center)
    return guide.arrival >= scenario.n_steps - 2 and (guide.positions @ ahead).min() > -0.1


def assess(values, changes=None):
    """Table II of a geometry by the paper's method and with Ipopt, and under small changes."""
    scenario = first.with_values(values)
    guide = csw.plan(scenario, "projected-gradient", certify=False)
    nominal = table_2_of_reading(scenario, runs=RUNS)
    row = {name: nominal[name] for name in PAPER_SUCCESS} | {"deviation": deviation(nominal)}
    worst = row["deviation"]
    for _, change in list(geometry_changes(scenario))[:changes]:
        changed = table_2_of_reading(scenario.with_values(change), runs=RUNS)
        worst = max(worst, deviation(changed))
    ipopt = table_2_with_ipopt(scenario)
    row |= {f"{name}, Ipopt": ipopt[name] for name in PAPER_SUCCESS}
    return row | {"worst deviation": worst, "direct": is_direct(scenario, guide)}


first = csw.load_scenario("paper-1")


def search(count, seed=0, limit=1.0):
    """Random candidates by the paper's method whose deviation is at most `limit`, best first."""
    rng, found = np.random.default_rng(seed), []
    for _ in range(count):
        values = random_geometry(rng)
        scenario = first.with_values(values)
        try:
            guide = csw.plan(scenario, "projected-gradient", certify=False)
            if not is_direct(scenario, guide):
                continue
            row = table_2_of_reading(scenario, runs=SEARCH_RUNS)
        except csw.CasswarmError:
            continue  # the guide does not arrive
        if deviation(row) <= limit:
            found.append((deviation(row), len(found), values))
            print(f"{deviation(row):.2f}", values)
    return [values for *_, values in sorted(found)]


# %% [markdown]
# ## Results
#
# `paper-1`; a geometry that agrees with Table II better by the paper's method, but where members
# on guides by Ipopt do better than any formation, since one of them flies around the radars; and
# an earlier calibration with Ipopt, whose guide starts backwards. (The geometry of `paper-1` was
# found by the search below and then by small random changes of its best candidates, with regard to
# Ipopt's numbers, too.)

# %%
CANDIDATES = {
    "paper-1": {
        "target.center": list(first.target.center),
        "hazard.radars": first.hazard.radar_positions.tolist(),
        "swarm.positions": first.positions.tolist(),
    },
    "one flies around": geometry((13.9, 7.9), [(5.2, 4.4), (6.0, 3.0)], "square", 0.78),
    "starts backwards": geometry((8.0, 6.5), [(4.4, 4.6), (4.5, 3.0)], "cross", 0.5),
}
for rank, values in enumerate(search(N_CANDIDATES)[:3], start=1):
    CANDIDATES[f"search {rank}"] = values
table = pd.DataFrame(
    {name: assess(values, None if N_CANDIDATES else 2) for name, values in CANDIDATES.items()}
).T
table

# %%
if N_CANDIDATES:
    print(table.T.to_string())
