"""The states of a session, of which one is present; changes can be undone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..scenario import Scenario


@dataclass(frozen=True)
class Moment:
    """A state of the history.

    Parameters
    ----------
    scenario : Scenario
    policy : str
    gesture : object
        Changes of one gesture, such as a drag, are one state; None is a gesture of its own.
    """

    scenario: Scenario
    policy: str
    gesture: object = None


class History:
    """States in their order, and the present one among them."""

    def __init__(self, first: Moment) -> None:
        self._moments, self._index = [first], 0

    @property
    def first(self) -> Moment:
        """The first state."""
        return self._moments[0]

    @property
    def present(self) -> Moment:
        """The present state."""
        return self._moments[self._index]

    @property
    def can_undo(self) -> bool:
        """Whether there is an earlier state."""
        return self._index > 0

    @property
    def can_redo(self) -> bool:
        """Whether a state was undone."""
        return self._index + 1 < len(self._moments)

    def append(self, moment: Moment) -> bool:
        """Make another state the present and last one; return whether it differs.

        It replaces the present one if both are of the same gesture.
        """
        present = self.present
        if (moment.scenario, moment.policy) == (present.scenario, present.policy):
            return False
        same = moment.gesture is not None and moment.gesture == present.gesture
        self._moments[self._index + (not same) :] = [moment]
        self._index = len(self._moments) - 1
        return True

    def shift(self, steps: int) -> bool:
        """Go to a later state, or with a negative number to an earlier one, if there is one."""
        index = self._index + steps
        exists = 0 <= index < len(self._moments)
        self._index = index if exists else self._index
        return exists
