"""Who survives a step, outcome by outcome: plain Python that Numba compiles.

`casswarm._util.jit` makes a module of this text, in which `compiled` is Numba's decorator. Imported
as it stands, nothing is compiled, and the functions run as they are.
"""

# mypy: ignore-errors
import numpy as np

if "compiled" not in globals():

    def compiled(function):
        return function


@compiled
def split(
    first,
    weights,
    survival,
    alive,
    inside,
    cutoff,
    most_pruned,
    parents,
    fates,
    masses,
    arrival,
    population,
    survivors,
    members,
    pruned,
):
    """Split the states from `first` on by who survives; return the next state and the outcomes.

    Outcomes in which the run goes on are written to `parents`, `fates` and `masses`, until these
    are full; those in which it ends are added to `arrival`, `survivors` and `members`. They are
    enumerated depth first over the living, and cut where none below can have the mass `cutoff`:
    what is cut off is added to `pruned` of its state. Where that is more than the part
    `most_pruned` of the state, the state is left whole, and `pruned` of it set to -1. `population`
    counts who is alive afterwards.
    """
    n, room = alive.shape[1], masses.size
    living, choice = np.empty(n, np.int64), np.empty(n + 1, np.int64)
    prefix, rest = np.empty(n + 1), np.empty(n + 1)
    fate = np.zeros(n, np.bool_)
    counts = np.empty((3, n + 1))  # of this state: population, survivors, members
    filled = 0
    for state in range(first, weights.size):
        start = filled
        k = 0
        for i in range(n):
            fate[i] = False
            if alive[state, i]:
                living[k] = i
                k += 1
        rest[k] = 1.0
        for d in range(k - 1, -1, -1):
            p = survival[state, living[d]]
            rest[d] = rest[d + 1] * max(p, 1.0 - p)
        # a state that may not fit is left for the next call, which has room for 2^12 or more
        if start > 0 and room - start < min(1 << min(k, 20), room // 4):
            return state, start
        counts[:] = 0.0
        arrived, lost = 0.0, 0.0
        prefix[0], choice[0], d = weights[state], 0, 0
        while d >= 0:
            if d == k:
                mass, left, there = prefix[d], 0, False
                for i in range(n):
                    if fate[i]:
                        left += 1
                        there = there or inside[state, i]
                counts[0, left] += mass
                if there or left == 0:
                    counts[1, left] += mass
                    if there:
                        arrived += mass
                    for i in range(n):
                        if fate[i]:
                            counts[2, i] += mass
                elif filled < room:
                    parents[filled], masses[filled] = state, mass
                    for i in range(n):
                        fates[filled, i] = fate[i]
                    filled += 1
                else:
                    counts[0, left] -= mass
                    lost += mass
                d -= 1
                continue
            way = choice[d]
            choice[d] = way + 1
            i = living[d]
            if way == 2:
                fate[i] = False
                d -= 1
                continue
            p = survival[state, i]
            mass = prefix[d] * (p if way == 0 else 1.0 - p)
            fate[i] = way == 0
            if mass <= 0.0:
                continue
            if mass * rest[d + 1] < cutoff or (filled == room and d + 1 < k):
                lost += mass
                continue
            prefix[d + 1] = mass
            d += 1
            choice[d] = 0
        if lost > most_pruned * weights[state]:
            pruned[state] = -1.0
            filled = start
            continue
        pruned[state] = lost
        arrival[0] += arrived
        for i in range(n + 1):
            population[i] += counts[0, i]
            survivors[i] += counts[1, i]
            if i < n:
                members[i] += counts[2, i]
    return weights.size, filled


@compiled
def grouped(words, slots, first, back):
    """Group equal rows of unsigned integers (B, w); return the number of groups.

    `slots`, a power of two of them and more than B, holds -1 and is used as a hash table. Into
    `first` is written the first row of every group, into `back` the group of every row.
    """
    mask, groups = slots.size - 1, 0
    for row in range(words.shape[0]):
        h = np.uint64(0x9E3779B97F4A7C15)
        for word in range(words.shape[1]):
            h = (h ^ words[row, word]) * np.uint64(0xBF58476D1CE4E5B9)
            h = h ^ (h >> np.uint64(29))
        slot = np.int64(h & np.uint64(mask))
        while True:
            group = slots[slot]
            if group < 0:
                slots[slot], first[groups], back[row] = groups, row, groups
                groups += 1
                break
            same = True
            for word in range(words.shape[1]):
                if words[row, word] != words[first[group], word]:
                    same = False
                    break
            if same:
                back[row] = group
                break
            slot = (slot + 1) & mask
    return groups
