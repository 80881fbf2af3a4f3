"""The enumerated chain as a matrix of transitions with labels, and its file for model checkers.

States of the swarm come first, step by step, and then one state for every way in which a run ends.
The equations are those of ``docs/model-checkers.md``.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .._util.files import atomic_write
from .._util.text import counted
from ..typing import BoolArray, FloatArray, IntArray, Interval
from .exact import Layer, StateSpaceExpansion

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False, repr=False)
class MarkovChain:
    """The Markov chain of a swarm under a policy: S states, of which some are absorbing.

    Parameters
    ----------
    transitions : csr_array, shape (S, S)
        Probability of every transition; a step of the run is a transition, and the end of a run
        remains where it is. The first state is the initial one.
    labels : dict of name to (S,) bool
        ``arrived``, ``late`` (at the last step nobody has arrived), ``lost`` (all members) and
        ``left_out`` (histories too improbable to be followed) are how a run ends; ``survivors_k``
        are the ends of runs with k survivors.
    steps : (S,) int
        t of the states of the swarm, -1 for ends.
    alive : (S, n) bool
        Living members; of ends, no member is marked.
    positions : (S, n, 2)
        X(t), in units of length; zeros for members that are destroyed, and for ends.
    """

    transitions: csr_array
    labels: dict[str, BoolArray] = field(repr=False)
    steps: IntArray
    alive: BoolArray
    positions: FloatArray

    @cached_property
    def success(self) -> Interval:
        """Bounds of the probability that the run ends in the target."""
        end = self.after(int(self.steps.max()) + 1)
        low, left_out = (float(end[self.labels[name]].sum()) for name in ("arrived", "left_out"))
        return Interval(low, min(1.0, low + left_out))

    def after(self, steps: int) -> FloatArray:
        """Probability (S,) of every state after so many steps."""
        row: FloatArray = np.zeros(len(self.steps))
        row[0] = 1.0
        for _ in range(steps):
            row = np.asarray(row @ self.transitions)
        return row

    def export(self, path: str | os.PathLike[str]) -> Path:
        """Write the chain in Storm's format DRN, with all digits.

        The reward models are ``steps``, 1 in states of the swarm, and ``alive``, the number of
        living members in them.

        Parameters
        ----------
        path : path_like
            A file, usually ``NAME.drn``; one that exists is replaced.

        Returns
        -------
        Path

        Raises
        ------
        OSError
            The file cannot be written.
        """
        target = Path(path)
        atomic_write(target, "\n".join(self._lines()) + "\n")
        return target

    def _lines(self) -> Iterator[str]:
        """Lines of the file."""
        matrix, swarm = self.transitions, self.steps >= 0
        names = np.array(list(self.labels))
        marked = np.array(list(self.labels.values()))
        size = len(self.steps)
        yield from ("@type: DTMC", "@parameters", "", "@reward_models", "steps alive")
        yield from ("@nr_states", str(size), "@nr_choices", str(size), "@model")
        living = self.alive.sum(axis=1)
        for state in range(size):
            labels = [*(["init"] if state == 0 else []), *names[marked[:, state]]]
            rewards = f"[{int(swarm[state])}, {living[state]}]"
            yield " ".join(["state", str(state), rewards, *labels])
            yield "\taction 0"
            for k in range(matrix.indptr[state], matrix.indptr[state + 1]):
                yield f"\t\t{matrix.indices[k]} : {float(matrix.data[k])!r}"

    def __repr__(self) -> str:
        low, high = self.success
        states = counted(len(self.steps), "state")
        return (
            f"MarkovChain({states}, {self.transitions.nnz} transitions, "
            f"success=[{low:.6f}, {high:.6f}])"
        )


def markov_chain_of(expansion: StateSpaceExpansion) -> MarkovChain:
    """The chain of an expansion that is new."""
    from scipy.sparse import coo_array  # slow to import

    layers, _ = expansion.layers(lambda move: move.inside.astype(float))
    n, steps = expansion.scenario.n, expansion.scenario.n_steps
    first = np.cumsum([0, *(len(layer.states) for layer in layers)])
    ends = _Ends(int(first[-1]), n)
    parts = [ends.remain()]
    for t, layer in enumerate(layers):
        parts.append(_followed(layer, int(first[t]), int(first[t + 1])))
        parts.append(ends.reached(layer, int(first[t]), followed=parts[-1], last=t + 1 == steps))
    starts, targets, data = map(np.concatenate, zip(*parts, strict=True))
    positive = data > 0.0
    entries = data[positive], (starts[positive], targets[positive])
    size = ends.first + ends.number
    times = np.full(size, -1)
    alive, positions = np.zeros((size, n), bool), np.zeros((size, n, 2))
    for t, layer in enumerate(layers):
        rows = slice(int(first[t]), int(first[t + 1]))
        times[rows] = t
        alive[rows], positions[rows] = layer.states.alive, layer.states.positions
    matrix = coo_array(entries, shape=(size, size)).tocsr()
    return MarkovChain(matrix, ends.labels, times, alive, positions)


Entries = tuple[IntArray, IntArray, FloatArray]  # rows, columns and probabilities


def _followed(layer: Layer, first: int, following: int) -> Entries:
    """Transitions to states of the next step: products over the members that were alive."""
    edges, step = layer.edges, layer.step
    parents = np.repeat(np.arange(len(layer.states)), np.diff(edges.starts))
    kept = edges.children >= 0
    parents, survived = parents[kept], edges.survived[kept]
    factors = np.where(survived, step.survival[parents], 1.0 - step.survival[parents])
    factors[~step.alive[parents]] = 1.0
    return first + parents, following + edges.children[kept], factors.prod(axis=1)


@dataclass(frozen=True)
class _Ends:
    """The absorbing states: arrived and late with 1, ..., n survivors, lost, left out."""

    first: int
    n: int

    @property
    def number(self) -> int:
        """How many there are."""
        return 2 * self.n + 2

    @property
    def labels(self) -> dict[str, BoolArray]:
        """Labels of all states."""
        n, swarm = self.n, np.zeros(self.first, bool)
        kinds = np.array(["arrived"] * n + ["late"] * n + ["lost", "left_out"])
        survivors = np.array([*range(1, n + 1), *range(1, n + 1), 0, -1])
        ends = {name: kinds == name for name in dict.fromkeys(kinds.tolist())}
        ends |= {f"survivors_{k}": survivors == k for k in range(n + 1)}
        return {name: np.append(swarm, end) for name, end in ends.items()}

    def remain(self) -> Entries:
        """Transitions from every end to itself."""
        own = self.first + np.arange(self.number)
        return own, own, np.ones(self.number)

    def reached(self, layer: Layer, first: int, followed: Entries, *, last: bool) -> Entries:
        """Transitions of a layer's states to ends; the rest of their probability is left out."""
        arrived, going = survivors_after(layer)
        size, n = len(layer.states), self.n
        ends = np.zeros((size, self.number))
        ends[:, :n], ends[:, 2 * n] = arrived[:, 1:], going[:, 0]
        if last:
            ends[:, n : 2 * n] = going[:, 1:]
        else:
            rows, _, probabilities = followed
            kept = np.bincount(rows - first, probabilities, size)
            left = going[:, 1:].sum(axis=1) - kept
            ends[:, 2 * n + 1] = np.where(left > n * 1e-15, left, 0.0)
        rows, columns = np.nonzero(ends)
        return first + rows, self.first + columns, ends[rows, columns]


def survivors_after(layer: Layer) -> tuple[FloatArray, FloatArray]:
    """Probabilities (S, n+1) of k survivors of a step, with enough arrivals and with too few.

    The joint distribution of the numbers of survivors and of those in the target, member by member.
    """
    inside_target, enough = layer.move.inside, layer.move.arrivals
    size, n = layer.step.alive.shape
    joint = np.zeros((size, enough + 1, n + 1))  # in the target, `enough` or more in the last row
    joint[:, 0, 0] = 1.0
    for i in range(n):
        p = np.where(layer.step.alive[:, i], layer.step.survival[:, i], 0.0)[:, None, None]
        one_more = np.zeros_like(joint)
        one_more[:, :, 1:] = joint[:, :, :-1]
        inside = np.zeros_like(joint)
        inside[:, 1:] = one_more[:, :-1]
        inside[:, -1] += one_more[:, -1]
        survives = np.where(inside_target[:, i, None, None], inside, one_more)
        joint = (1.0 - p) * joint + p * survives
    return joint[:, -1], joint[:, :-1].sum(axis=1)
