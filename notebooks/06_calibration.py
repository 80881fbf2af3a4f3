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
# searches for round numbers for which the exact success probabilities of its three policies are
# close to the paper's, and remain so under small changes of the geometry. The parameters of Table
# I are never changed. The result is a calibration, not the paper's figure.
#
# By default the script assesses the geometry of `paper-1` and one other under a few small
# changes, in half a minute. With `CASSWARM_CALIBRATION=500` in the environment, or the number as
# the argument of the script, it first searches that many random candidates (some seconds each)
# and then assesses the best under all changes. `docs/paper.md` shows the result of such a search.

# %%
import itertools
import os
import sys

import numpy as np
import pandas as pd

import casswarm as csw
from casswarm.chain.confidence import wilson

N_CANDIDATES = int(os.environ.get("CASSWARM_CALIBRATION", "0"))
if __name__ == "__main__" and sys.argv[1:] and sys.argv[1].isdigit():
    N_CANDIDATES = int(sys.argv[1])

PAPER = {"naive": 0.32, "constrained": 0.64, "leader": 0.68}
INTERVALS = {name: wilson(round(50 * value), 50) for name, value in PAPER.items()}
INTERVALS

# %% [markdown]
# ## Parameters
#
# Five members in a cross (or a square with one at its centre) around the origin; a target; two
# radars on both sides of the straight line to it, at a fraction `along` of its length, each at a
# distance `aside` from it, one `skew` further along than the other; and the guide's a_max. All
# values are round.

# %%
PATTERNS = {
    "cross": [[0, 0], [1, 0], [0, 1], [-1, 0], [0, -1]],
    "square": [[0, 0], [1, 1], [-1, 1], [-1, -1], [1, -1]],
}
GRID = {
    "target": [(8, 6), (8, 6.5), (9, 6), (10, 6), (10, 7), (10, 8), (12, 8), (12, 9)],
    "pattern": ["cross", "square"],
    "spacing": [0.3, 0.4, 0.5, 0.6],
    "along": [0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5],
    "aside": [0.5, 0.6, 0.7, 0.8, 0.9, 1.0],
    "skew": [-0.6, -0.3, 0.0, 0.3, 0.6],
    "a_max": [0.1, 0.2, 0.3, 0.5],
    "arrival": ["horizon", "any"],
}


def radars_of(target, along, aside, skew):
    """Two radars (2, 2) beside the straight line, to one decimal."""
    line = np.array(target, float)
    ahead = line / np.hypot(*line)
    left = np.array([-ahead[1], ahead[0]])
    offset = aside * left + skew / 2 * ahead
    return np.round([along * line + offset, along * line - offset], 1)


def values_of(row):
    """Scenario values of a candidate."""
    radars = radars_of(row["target"], row["along"], row["aside"], row["skew"])
    positions = row["spacing"] * np.array(PATTERNS[row["pattern"]], float)
    return {
        "target.center": row["target"],
        "swarm.positions": np.round(positions, 3).tolist(),
        "hazard.radars": radars.tolist(),
        "guide.a_max": row["a_max"],
        "guide.arrival": row["arrival"],
        "guide.search": "local",
    }


# %% [markdown]
# ## Assessment of a candidate
#
# Its *deviation* is the largest distance of an exact probability from the paper's, over its three
# policies, in units of the half-width of the 95 % interval of 50 runs on that side: 1 is the end
# of the interval. Its *worst deviation* is the largest over small changes that should not matter:
# how far the guide enters the target (`guide.margin`), its a_max, and radars moved by 0.05.


# %%
def successes(scenario, tolerance=1e-2, max_states=20_000, policies=tuple(PAPER)):
    """Exact success probabilities (midpoints of the bounds)."""
    guide = csw.plan(scenario, certify=False)
    options = {"tolerance": tolerance, "max_states": max_states, "guide": guide}
    return {name: np.mean(csw.evaluate(scenario, name, **options).success) for name in policies}


def deviation(success):
    """Largest distance from the paper's numbers, in half-widths; plus 3 if the order differs."""
    worst = 0.0
    for name, value in success.items():
        low, high = INTERVALS[name]
        paper = PAPER[name]
        worst = max(worst, (value - paper) / ((high if value > paper else low) - paper))
    ordered = list(success.values()) == sorted(success.values())
    return worst if ordered else worst + 3


def changes(values):
    """Small changes of a candidate's values, by name."""
    for margin in (0.05, 0.15):  # below sqrt(rho) members in the corridor may miss the target
        yield f"margin {margin}", {"guide.margin": margin}, ("naive",)
    for margin in (0.25, 0.3):
        yield f"margin {margin}", {"guide.margin": margin}, tuple(PAPER)
    for factor in (0.8, 1.25):
        yield f"a_max x {factor}", {"guide.a_max": factor * values["guide.a_max"]}, tuple(PAPER)
    for signs in itertools.product((-1, 1), repeat=3):
        moved = np.array(values["hazard.radars"])
        moved += 0.05 * np.array([[signs[0], signs[1]], [signs[2], signs[0] * signs[1] * signs[2]]])
        yield f"radars {signs}", {"hazard.radars": moved.tolist()}, tuple(PAPER)


def assess(scenario, values, limit=np.inf):
    """Row of a candidate; small changes stop once the deviation exceeds `limit`."""
    nominal = successes(scenario.with_values(values))
    row = {**nominal, "deviation": deviation(nominal)}
    results, worst = [nominal], row["deviation"]
    for _, change, policies in changes(values):
        if worst > limit:
            break
        changed = scenario.with_values({**values, **change})
        results.append(successes(changed, policies=policies))
        worst = max(worst, deviation(results[-1]))
    for name in PAPER:
        row[f"{name} from"] = min(result[name] for result in results if name in result)
        row[f"{name} to"] = max(result[name] for result in results if name in result)
    return row | {"worst deviation": worst, "changes": len(results) - 1}


# %%
first = csw.load_scenario("paper-1")
second = csw.load_scenario("paper-2")


def search(count, seed=0, limit=1.5):
    """The best of `count` random candidates, cheapest tests first."""
    rng, rows = np.random.default_rng(seed), []
    for _ in range(count):
        row = {name: options[rng.integers(len(options))] for name, options in GRID.items()}
        values = values_of(row)
        try:
            scenario = first.with_values(values)
            if deviation(successes(scenario, policies=["leader"])) > 0.6:
                continue
            if deviation(successes(scenario, policies=["naive"])) > 0.9:
                continue
            if deviation(successes(scenario)) > 0.9:
                continue
            row |= assess(first, values, limit)
        except csw.CasswarmError:
            continue  # no guide, or a member that starts at a radar
        rows.append(row)
        print(len(rows), row["target"], values["hazard.radars"], f"{row['worst deviation']:.2f}")
    return sorted(rows, key=lambda row: row["worst deviation"])


# %% [markdown]
# ## Candidates
#
# The geometry of `paper-1`, the best ones of searches, and one chosen by hand among targets
# straight ahead, where the box of velocities limits the guide to a speed of 2 instead of 2.8.

# %%
CROSS, SQUARE = (np.array(PATTERNS[name], float) for name in ("cross", "square"))


def candidate(target, radars, pattern, arrival, a_max=0.2):
    """Scenario values of a candidate with a given geometry."""
    return {
        "target.center": target,
        "swarm.positions": np.round(pattern, 3).tolist(),
        "hazard.radars": radars,
        "guide.a_max": a_max,
        "guide.arrival": arrival,
        "guide.search": "local",
    }


CANDIDATES = {
    "paper-1": candidate((8, 6.5), [[4.4, 4.6], [4.5, 3.0]], 0.5 * CROSS, "horizon"),
    "straight": candidate((15, 0), [[9, 0.8], [9, -0.8]], 0.5 * CROSS, "any"),
    "early": candidate((9, 6), [[1.8, 1.8], [2.7, 1.2]], 0.3 * SQUARE, "any"),
    "middle": candidate((10, 6), [[4.1, 3.3], [4.9, 2.1]], 0.5 * SQUARE, "horizon"),
}


def row_of(values, thorough):
    """Robustness of a candidate, scenario II, and the paper's own guide."""
    scenario = first.with_values(values)
    guide = csw.plan(scenario, certify=False)
    row = assess(first, values) if thorough else assess(first, values, limit=-1)
    exact = csw.evaluate(scenario, "constrained", 1e-2, max_states=20_000, guide=guide)
    row |= {"risk": guide.risk, "arrival": guide.arrival, "infeasible": exact.infeasible}
    collisions = second.with_values(values)
    for name in PAPER:
        estimate = csw.estimate(
            collisions, name, 1000, max_states=3000, tolerance=1e-4, guide=guide
        )
        row[f"II {name}"] = np.mean(estimate.success)
    if thorough:
        papers = csw.plan(scenario, "projected-gradient", certify=False)
        row["projected-gradient risk"] = papers.risk
    return row


# %%
if N_CANDIDATES:
    for rank, row in enumerate(search(N_CANDIDATES)[:4], start=1):
        CANDIDATES[f"search {rank}"] = values_of(row)
chosen = CANDIDATES if N_CANDIDATES else dict(list(CANDIDATES.items())[:2])
table = pd.DataFrame(
    {name: row_of(values, bool(N_CANDIDATES)) for name, values in chosen.items()}
).T
table.astype(float).round(3)

# %%
if N_CANDIDATES:
    print(table.astype(float).round(3).T.to_string())

# %% [markdown]
# Sensitivity of `paper-1`: the leader and constrained policies hardly change, the naive policy
# changes a lot. Its members plan independently and have time to spare, and *when* each passes the
# gate hardly matters to itself, but does to the others.

# %%
margins = [change for change in changes(CANDIDATES["paper-1"]) if change[0].startswith("margin")]
sensitivity = {"unchanged": successes(first)} | {
    name: successes(first.with_values(change), policies=["naive", "leader"])
    for name, change, _ in margins
}
pd.DataFrame(sensitivity).T.round(3)

# %% [markdown]
# The candidate "straight" is less sensitive, and there the paper's own projected gradient method
# finds nearly the same guide. But its guide flies at v_max from start to target, so members that
# fall behind the corridor never catch up: four of five are outside it at every step, while the
# paper describes a formation that is reached quickly. This is why `paper-1` has the other
# geometry.
