"""Families of changes of a joint plan: in roles, direction, time and path."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ...problems.joint_instances import JointTask
from ...typing import FloatArray
from ..kinematics import integrate
from .screening import Family, InitialGuess, padded, turns

MAX_PERMUTED = 5
"""Maximum number of members of swarms whose roles are exchanged in all ways."""

_SHIFTS = (-2, -1, 1, 2)  # of the last arrival step
_TURNS = 12  # of a formation
_CHANGED = ", changed"


def changes(
    task: JointTask, plan: InitialGuess, paths: Mapping[str, Sequence[FloatArray]]
) -> Iterator[Family]:
    """Families of plans that differ from a plan in one respect.

    Parameters
    ----------
    task : JointTask
    plan : InitialGuess
    paths : mapping of str to sequence of (T+1, 2)
        The paths of each homotopy class, best first.
    """
    name = f"{plan.name.removesuffix(_CHANGED)}{_CHANGED}"
    path = integrate(task.start, plan.velocities, task.motion.dt)
    yield _exchanged(name, task, plan, path)
    yield _turned(name, task, plan, path)
    yield from _stretched(name, task, plan, path)
    if paths:
        yield _rerouted(name, task, plan, path, [each[0] for each in paths.values()])


def _exchanged(name: str, task: JointTask, plan: InitialGuess, path: FloatArray) -> Family:
    """Members take each other's trajectories: in all ways if there are few, else up to three."""
    n = path.shape[1]
    orders = itertools.permutations(range(n)) if n <= MAX_PERMUTED else _cycles(n)
    others = np.array([order for order in orders if order != tuple(range(n))])
    return Family(name, plan.arrivals[others], padded(path, task.steps)[1:, others])


def _cycles(n: int) -> Iterator[tuple[int, ...]]:
    """Permutations of n members that move two or three of them."""
    for size in (2, 3):
        for moved in itertools.combinations(range(n), size):
            for shift in range(1, size):
                order = list(range(n))
                for k, member in enumerate(moved):
                    order[member] = moved[(k + shift) % size]
                yield tuple(order)


def _turned(name: str, task: JointTask, plan: InitialGuess, path: FloatArray) -> Family:
    """The formation turned and reflected about its centroid, at all steps by the same."""
    turned = turns(2 * np.pi * np.arange(_TURNS) / _TURNS)
    matrices = np.concatenate([turned[1:], turned @ np.diag([1.0, -1.0])])
    whole = padded(path, task.steps)[1:, None]  # (N, 1, n, 2)
    center = whole.mean(axis=2, keepdims=True)
    goals = center + (whole - center) @ matrices
    return Family(name, np.tile(plan.arrivals, (len(matrices), 1)), goals)


def _stretched(
    name: str, task: JointTask, plan: InitialGuess, path: FloatArray
) -> Iterator[Family]:
    """All members along their paths in more or less time."""
    last = len(path) - 1
    for steps in (last + shift for shift in _SHIFTS):
        if not 0 < steps <= task.steps:
            continue
        times = np.linspace(0, last, steps + 1)
        before = np.minimum(times.astype(int), last - 1)
        share = (times - before)[:, None, None]
        stretched = (1 - share) * path[before] + share * path[before + 1]
        arrivals = np.ceil(plan.arrivals * (steps / last) - 1e-9).astype(int)
        yield Family(name, arrivals[None], padded(stretched, task.steps)[1:, None])


def _rerouted(
    name: str, task: JointTask, plan: InitialGuess, path: FloatArray, others: list[FloatArray]
) -> Family:
    """One member along a single agent's path."""
    n, whole = path.shape[1], padded(path, task.steps)[1:]
    cases = list(itertools.product(range(n), others))
    arrivals = np.tile(plan.arrivals, (len(cases), 1))
    goals = np.repeat(whole[:, None], len(cases), axis=1)
    for case, (member, other) in enumerate(cases):
        arrivals[case, member] = len(other) - 1
        goals[:, case, member] = padded(other, task.steps)[1:]
    return Family(name, arrivals, goals)
