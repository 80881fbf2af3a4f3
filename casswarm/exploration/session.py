"""A session of exploring: the present scenario, its history, and what is known about it."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from pickle import PicklingError
from threading import Condition
from typing import Any

from ..errors import CasswarmError, PlanningError, ScenarioError
from ..guide.guide import Guide
from ..guide.mixture import MixedGuide
from ..policies.named import require_policy_name
from ..scenario import Scenario
from ..scenario.scenario_files import require_scenario, save_scenario
from ..scenario.variations import with_parameters
from ..studies.simulation import Study
from .answers import Answer, Question, Worker
from .radar_points import with_radar_at


@dataclass(frozen=True)
class Moment:
    """A state of the history.

    Changes of one gesture, such as a drag, are one state; None is a gesture of its own.
    """

    scenario: Scenario
    policy: str
    ambiguity: float = 0.0
    gesture: object = field(default=None, compare=False)


MAX_MOMENTS = 1000
"""Largest number of states of a history: the oldest ones except the first are forgotten."""


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
        """True if there is an earlier state."""
        return self._index > 0

    @property
    def can_redo(self) -> bool:
        """True if there is an undone state."""
        return self._index + 1 < len(self._moments)

    def append(self, moment: Moment) -> bool:
        """Make another state the present and last one; return whether it differs.

        It replaces the present one if both are of the same gesture.
        """
        present = self.present
        if moment == present:
            return False
        same = moment.gesture is not None and moment.gesture == present.gesture
        self._moments[self._index + (not same) :] = [moment]
        del self._moments[1 : 1 + max(0, len(self._moments) - MAX_MOMENTS)]
        self._index = len(self._moments) - 1
        return True

    def shift(self, steps: int) -> bool:
        """Go to a later state, or with a negative number to an earlier one, if there is one."""
        index = self._index + steps
        exists = 0 <= index < len(self._moments)
        self._index = index if exists else self._index
        return exists


POINTS = ("member", "radar", "target")
"""What can be moved."""


def _moved(
    scenario: Scenario, point: str, index: int, position: tuple[float, float]
) -> dict[str, object]:
    """Values of a scenario, by key, in which a point of `POINTS` has moved; a radar at time 0."""
    if point == "target":
        return {"target.center": position}
    if point == "radar":
        return with_radar_at(scenario, index, position)
    positions = list(scenario.swarm.positions)
    positions[index] = position
    return {"swarm.positions": positions}


class Session:
    """The present scenario and policy, changes that can be undone, and answers about them.

    Of a hazard that is not known, guides are mixed for the priors that `ambiguity` describes, from
    0, the prior of the scenario, to 1, all of them: see `Question`.

    Every change asks a `Worker`, which answers in stages. An impossible scenario changes nothing:
    `problem` says why. Methods may be called from any thread.

    `save` writes to `file`, by default a new one, NAME-explored.toml in the current folder.
    """

    def __init__(
        self, scenario: Scenario, policy: str = "leader", file: Path | None = None
    ) -> None:
        require_scenario("explore", scenario)
        require_policy_name(policy)
        self.history = History(Moment(scenario, policy))
        self._file, self._version = file, 0
        self._listeners: list[Callable[[], None]] = []
        self._lock, self._asked = Condition(), False
        self._worker = Worker(self._receive)
        self.problem = ""  # why the last change was refused
        self.answer: Answer | None = None  # about the present scenario; None before the first stage
        self.last_good: Answer | None = None  # with a guide that arrives
        self.last_mixed: Answer | None = None  # with a mixture of guides

    @property
    def scenario(self) -> Scenario:
        """The present scenario."""
        return self.history.present.scenario

    @property
    def policy(self) -> str:
        """Name of the present policy."""
        return self.history.present.policy

    @property
    def ambiguity(self) -> float:
        """How far the priors may be from that of the scenario, from 0 to 1."""
        return self.history.present.ambiguity

    @property
    def revision(self) -> int:
        """Number of changes so far of the scenario or the policy."""
        return self._version

    # --- changes

    def change(self, values: Mapping[str, Any], gesture: object = None) -> bool:
        """Change parameters, by key as in `casswarm.sweep`; return whether that is possible."""
        return self._try(lambda: {"scenario": with_parameters(self.scenario, values)}, gesture)

    def move(
        self, point: str, index: int, position: tuple[float, float], gesture: object = None
    ) -> bool:
        """Move a point of `POINTS`, one of several by its index; return whether it is possible.

        Radars are those of `radar_points`; `position` is that at time 0, and paths move with it.
        """

        def moved() -> dict[str, Any]:
            values = _moved(self.scenario, point, index, position)
            return {"scenario": self.scenario.with_values(values)}

        return self._try(moved, gesture)

    def choose_policy(self, name: str) -> bool:
        """Choose a policy by name; return whether there is one of that name."""

        def chosen() -> dict[str, Any]:
            require_policy_name(name)
            return {"policy": name}

        return self._try(chosen)

    def choose_ambiguity(self, ambiguity: float, gesture: object = None) -> bool:
        """Choose how far priors may be from the scenario's; return whether it is in [0, 1]."""

        def chosen() -> dict[str, Any]:
            if not 0 <= ambiguity <= 1:
                raise PlanningError(
                    f"ambiguity = {ambiguity:g}; allowed: from 0, the prior, to 1, the worst case",
                    ambiguity=ambiguity,
                )
            return {"ambiguity": float(ambiguity)}

        return self._try(chosen, gesture)

    def undo(self) -> None:
        """Return to the state before the last change."""
        self._shift(-1)

    def redo(self) -> None:
        """Return to the state before the last `undo`."""
        self._shift(1)

    def reset(self) -> None:
        """Return to the first state; this can be undone."""
        self._try(lambda: vars(self.history.first))

    def _try(self, make: Callable[[], dict[str, Any]], gesture: object = None) -> bool:
        """Change what `make` returns of the present state, or note why it is impossible."""
        with self._lock:
            try:
                moment = replace(self.history.present, **make() | {"gesture": gesture})
            except CasswarmError as error:
                self.problem = str(error)
            else:
                self.problem = ""
                if self.history.append(moment):
                    self._renew()
            possible = not self.problem
        self._tell()
        return possible

    def _shift(self, steps: int) -> None:
        with self._lock:
            self.problem = ""
            if self.history.shift(steps):
                self._renew()
        self._tell()

    # --- answers

    @property
    def guide(self) -> Guide:
        """Guide of the present scenario; waits until it is planned, or raises PlanningError."""
        guide: Guide = self._awaited("guide")
        return guide

    @property
    def mixture(self) -> MixedGuide:
        """Mixture of guides of the present scenario if its hazard is not known; waits for it."""
        if len(self.scenario.cases) == 1:
            raise PlanningError("the hazard is known: there is a guide, and no mixture of guides")
        mixture: MixedGuide = self._awaited("mixture")
        return mixture

    @property
    def study(self) -> Study:
        """The largest study of the present scenario and policy so far; waits for the first."""
        study: Study = self._awaited("study")
        return study

    def wait(self, timeout: float | None = None) -> Answer:
        """Wait for the complete answer, or raise TimeoutError after `timeout` seconds."""
        with self._lock:
            if not self._until(lambda answer: answer.done, timeout):
                raise TimeoutError(f"no complete answer within {timeout:g} s")
            assert self.answer is not None
            return self.answer

    def _awaited(self, name: str) -> Any:
        """A part of the present answer, as soon as it has one."""
        with self._lock:
            self._until(lambda answer: answer.done or getattr(answer, name) is not None)
            assert self.answer is not None
            value = getattr(self.answer, name)
            if value is None:
                raise PlanningError(self.answer.failure)
            return value

    def _until(self, ready: Callable[[Answer], bool], timeout: float | None = None) -> bool:
        """Wait for a state of the present answer; return whether it is reached in time."""

        def reached() -> bool:
            self._ask()  # again, if the process was ended meanwhile
            return self.answer is not None and ready(self.answer)

        return self._lock.wait_for(reached, timeout)

    def _renew(self) -> None:
        """Forget the answer about an earlier state; ask about this one if somebody listens."""
        self._version += 1
        self.answer, self._asked = None, False
        if self._listeners:
            self._ask()

    def _ask(self) -> None:
        if self._asked:
            return
        self._asked = True
        question = Question(self._version, self.scenario, self.policy, self.ambiguity)
        try:
            self._worker.ask(question)
        except (PicklingError, AttributeError, TypeError) as error:
            failure = f"the scenario's hazard cannot be sent to another process ({error})"
            self.answer = Answer(question, failure=failure, done=True)

    def _receive(self, answer: Answer) -> None:
        """Keep an answer; one about an earlier state is good until there is a newer one."""
        with self._lock:
            if answer.guide is not None and answer.guide.arrives:
                self.last_good = _newer(self.last_good, answer)
            if answer.mixture is not None:
                self.last_mixed = _newer(self.last_mixed, answer)
            if answer.question.version == self._version:
                self.answer = answer
            self._lock.notify_all()
        self._tell()

    # --- listeners

    def subscribe(self, listener: Callable[[], None]) -> Callable[[], None]:
        """Call a function after every change, from any thread; returns what ends that.

        Answers are computed while there are listeners. When the last one ends, so does the process.
        """
        with self._lock:
            self._listeners.append(listener)
            self._ask()

        def unsubscribe() -> None:
            with self._lock:
                if listener in self._listeners:
                    self._listeners.remove(listener)
                if not self._listeners:  # under the lock: another page may open just now
                    self.close()

        return unsubscribe

    def close(self) -> None:
        """End the process that answers; the next question starts it again."""
        with self._lock:
            self._worker.close()
            self._asked = self.answer is not None and self.answer.done
            self._lock.notify_all()

    def _tell(self) -> None:
        for listener in tuple(self._listeners):
            listener()

    # --- files

    def save(self) -> Path:
        """Write the present scenario to its file, and return the path."""
        with self._lock:
            if self._file is None:
                self._file = _new_file(self.scenario.name)
            save_scenario(self.scenario, self._file)
            return self._file


def _newer(known: Answer | None, answer: Answer) -> Answer:
    if known is None or answer.question.version >= known.question.version:
        return answer
    return known


def _new_file(name: str) -> Path:
    """A path in the current folder at which there is no file."""
    numbers = ("", *(f"-{number}" for number in range(2, 1000)))
    paths = (Path(f"{name}-explored{number}.toml").absolute() for number in numbers)
    new = next((path for path in paths if not os.path.lexists(path)), None)  # no link either
    if new is None:
        raise ScenarioError(f"there are {len(numbers)} files {name}-explored*.toml: remove some")
    return new
