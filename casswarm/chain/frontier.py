"""States that an enumeration has not expanded yet, by step."""

from __future__ import annotations

import numpy as np

from ..typing import FloatArray
from .states import States


class Frontier:
    """Batches of states for every step 0..N.

    Parameters
    ----------
    steps : int
        N.
    """

    def __init__(self, steps: int) -> None:
        self.batches: list[list[States]] = [[] for _ in range(steps + 1)]

    def __len__(self) -> int:
        return sum(len(batch) for batches in self.batches for batch in batches)

    @property
    def masses(self) -> FloatArray:
        """Mass (N+1,) of the states of every step."""
        return np.array([sum(batch.mass for batch in batches) for batches in self.batches])

    @property
    def mass(self) -> float:
        """Mass of all states."""
        return float(self.masses.sum())

    def add(self, step: int, states: States) -> None:
        """Add states of a step."""
        if len(states):
            self.batches[step].append(states)

    def pop(self, step: int) -> list[States]:
        """Remove and return the batches of a step."""
        batches, self.batches[step] = self.batches[step], []
        return batches

    def prune(self, max_states: int) -> FloatArray:
        """Remove the least probable states if there are more than `max_states`; half remain.

        Returns
        -------
        (N+1,)
            Mass removed from every step.
        """
        pruned = np.zeros(len(self.batches))
        count = len(self)
        if count <= max_states:
            return pruned
        weights = np.concatenate([b.weights for batches in self.batches for b in batches])
        rank = count - max_states // 2
        threshold = float(np.partition(weights, rank)[rank])
        for step in range(len(self.batches)):
            for batch in self.pop(step):
                retained = batch.weights >= threshold
                pruned[step] += batch.weights[~retained].sum()
                self.add(step, batch[retained])
        return pruned
