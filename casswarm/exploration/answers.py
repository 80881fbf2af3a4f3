"""Answers about a scenario in stages, and the process that computes them.

The guide comes first, with a mixture of guides if the hazard is not known, then its bound, runs,
and exact bounds. The process answers the newest question, and ends with the process that asks.
"""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from threading import RLock, Timer
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .._util.child import Channel, Child, packed
from .._util.user_code import USER_ERRORS, failure_text
from ..chain.distribution import OutcomeDistribution
from ..chain.exact import MAX_MEMBERS, ExpansionOptions, StateSpaceExpansion
from ..chain.transition import Lattice
from ..errors import CasswarmError
from ..guide import certify_guide
from ..guide.agent import initial_velocities, plan_from
from ..guide.guide import Guide
from ..guide.mixture import MixedGuide, certify_mixture, plan_mixture
from ..guide.plan import plan
from ..policies.base import Policy
from ..policies.user import repeated
from ..scenario.ambiguity import Ambiguity
from ..studies.inputs import resolve_policy
from ..studies.simulation import Study, simulate
from ..typing import FloatArray, Interval

if TYPE_CHECKING:
    from ..scenario import Scenario


SIZE = 96  # pixels along each side
_MARGIN = 0.15  # of the frame, relative to the larger side of what it holds
_BEYOND = 1.5  # ratio of the sides of the map and its frame, which a page may keep when it changes
_CAP = 0.995  # quantile of the rates at which the scale ends: near radars they are far higher
_MAPS = 41  # of steps, at most
_DECADES = 1e3  # ratio of the ends of the scale


@dataclass(frozen=True, eq=False)
class HazardMap:
    """Rates of a single agent at the pixels of a square map, on a logarithmic scale.

    Prior means if the hazard is not known. There are T maps of the same square: one, or of steps
    from the first to the last if rates depend on time.
    """

    low: FloatArray  # corners (2,) of the map
    high: FloatArray
    frame: FloatArray  # corners (2, 2) of the square within it that holds all points
    shades: NDArray[np.uint8]  # (T, SIZE, SIZE), rows from the bottom; 255 for the highest rates

    @classmethod
    def around(cls, scenario: Scenario, guide: Guide) -> HazardMap:
        """Map that holds the members, the target, the radars, the zones and the guide."""
        square, discs = np.array([[-1, -1], [1, 1]]), scenario.target.discs
        target = np.vstack([np.asarray(disc.center) + disc.radius * square for disc in discs])
        tables = [case.scenario.hazard_table for case in scenario.cases]
        radars = [np.reshape(table.starts, (-1, 2)) for table in tables]
        zones = [zone.corners for table in tables for zone in table.zone]
        points = np.vstack([scenario.positions, target, *radars, *zones, guide.positions])
        low, high = points.min(axis=0), points.max(axis=0)
        half = (0.5 + _MARGIN) * float((high - low).max())
        middle = 0.5 * (low + high)
        frame = np.stack([middle - half, middle + half])
        low, high = middle - _BEYOND * half, middle + _BEYOND * half
        axis = (np.arange(SIZE) + 0.5) / SIZE * 2 * _BEYOND * half
        pixels = np.stack(np.meshgrid(low[0] + axis, low[1] + axis), axis=-1)
        hazard = scenario.believed.hazard
        last = scenario.n_steps if hazard.changes else 0
        steps = np.linspace(0, last, min(last + 1, _MAPS)).round().astype(int)
        hazards = [hazard.after(int(step)) for step in steps]
        rates = np.stack([hazard.single_agent_rates(pixels) for hazard in hazards])
        return cls(low, high, frame, _shades(rates))


def _shades(rates: FloatArray) -> NDArray[np.uint8]:
    top = float(np.quantile(rates, _CAP))
    floor = max(float(rates.min()), top / _DECADES)
    if not 0 < floor < top:
        return np.zeros(rates.shape, np.uint8)
    scale = np.log(np.clip(rates, floor, top) / floor) / np.log(top / floor)
    return np.asarray(np.rint(255 * scale), np.uint8)


TOLERANCE = 1e-3
"""Width of the proven bounds of success at which the enumeration ends."""

MAX_STATES = 50_000
"""Number of states after which runs are sampled instead, unless the bounds are narrow enough."""

RUNS = (200, 800, 3200, 12_800)
"""Numbers of runs of the studies that follow each other while the bounds are wide."""

BOUND_GAPS = ((0.05, 0.5), (0.01, 2.0))
"""Relative gaps at which the proof of a bound on the risk ends, with their time limits."""

SAVED_RUNS = 5
"""Runs whose trajectories are saved, to be played."""

_PUBLISH = 0.15  # seconds between two states of an enumeration


class Superseded(Exception):  # noqa: N818  (no failure)
    """The work ends because another question waits."""


@dataclass(frozen=True)
class Question:
    """Question about the success of a policy on a scenario.

    Parameters
    ----------
    version : int
        Larger ones are newer.
    scenario : Scenario
    policy : str
    ambiguity : float
        Of a hazard that is not known: the priors for which guides are mixed, from 0, the prior of
        the scenario, to 1, all of them.
    """

    version: int
    scenario: Scenario
    policy: str
    ambiguity: float = 0.0

    @property
    def is_known(self) -> bool:
        """Whether the hazard has one case."""
        return len(self.scenario.cases) == 1

    @property
    def priors(self) -> Ambiguity:
        """The priors q with sum_k abs(q_k - p_k) <= 2 * ambiguity."""
        if 0 < self.ambiguity < 1:
            return Ambiguity("tv", 2 * self.ambiguity)
        return Ambiguity("worst" if self.ambiguity else "mean")


@dataclass(frozen=True, eq=False)
class Answer:
    """Partial or complete answer to a question.

    Parameters
    ----------
    question : Question
    hazard_map : HazardMap, optional
    guide : Guide, optional
        With a lower bound on the risk once it is proven. If the hazard is not known, that of its
        mean rates, without a bound.
    mixture : MixedGuide, optional
        If the hazard is not known, with an upper end of its value once it is proven.
    study : Study, optional
        The largest study so far.
    distribution : OutcomeDistribution, optional
        With bounds that become narrower.
    failure : str
        Why there is no guide, mixture or success probability; empty if all is well.
    done : bool
        Whether nothing is added any more.
    """

    question: Question
    hazard_map: HazardMap | None = None
    guide: Guide | None = None
    mixture: MixedGuide | None = None
    study: Study | None = None
    distribution: OutcomeDistribution | None = None
    failure: str = ""
    done: bool = False

    @property
    def drawn(self) -> bool:
        """Whether there is all that is drawn at once: other work makes way for a newer question."""
        mixed = self.question.is_known or self.mixture is not None or bool(self.failure)
        return self.guide is not None and mixed

    @property
    def success(self) -> tuple[Interval, bool] | None:
        """The narrowest interval of the success probability, and whether it is proven.

        Proven bounds, or the 95 % interval of the study's runs.
        """
        intervals = []
        if self.distribution is not None:
            intervals.append((self.distribution.success, True))
        if self.study is not None:
            row = self.study.summary.iloc[0]
            interval = Interval(float(row["success_low"]), float(row["success_high"]))
            intervals.append((interval, False))
        return min(intervals, key=lambda item: item[0].width, default=None)


class Inquiry:
    """The work on a question, which publishes what is known whenever something is added.

    `publish` receives every `Answer`; the last one has `done`. `interrupt` is called between the
    parts of the work once there is a guide; it may raise `Superseded`.
    """

    def __init__(
        self, question: Question, publish: Callable[[Answer], None], interrupt: Callable[[], None]
    ) -> None:
        self.answer, self._publish, self._interrupt = Answer(question), publish, interrupt

    def run(self, previous: Answer | None = None) -> None:
        """Answer the question, first by a search that starts from guides of a similar scenario.

        Errors become the answer's `failure`.
        """
        try:
            self._plan(previous)
            self._bound(*BOUND_GAPS[0])
            self._evaluate()
            self._add(done=True)
        except Superseded:
            raise
        except CasswarmError as error:
            self._add(failure=str(error), done=True)
        except USER_ERRORS as error:  # of a user's hazard, for example
            self._add(failure=failure_text(error), done=True)

    def _add(self, **values: Any) -> None:
        self.answer = replace(self.answer, **values)
        self._publish(self.answer)

    def _report(self, *_: Any) -> None:
        """Progress of a computation, which ends it if another question waits."""
        if self.answer.drawn:
            self._interrupt()

    def _plan(self, previous: Answer | None) -> None:
        """Plan by a search near the previous guides, then by a full search."""
        scenario, guide = self.answer.question.scenario, None
        near = None if previous is None else previous.guide
        if near is not None and is_near(scenario.believed, near):
            guide = _planned_near(scenario.believed, near)
            if guide is not None:
                self._add(guide=guide, hazard_map=HazardMap.around(scenario, guide))
        if guide is not None and previous is not None and previous.mixture is not None:
            self._mix(previous.mixture)
        self._report()
        full = plan(scenario.believed, certify=False, progress=self._report)
        if guide is None or full.risk < guide.risk:
            self._add(guide=full, hazard_map=HazardMap.around(scenario, full))
        self._mix(None)

    def _mix(self, near: MixedGuide | None) -> None:
        """Add a mixture of guides if the hazard is not known, by a search near another one."""
        question, known = self.answer.question, self.answer.mixture
        cases = [case.scenario for case in question.scenario.cases]
        if question.is_known or (near is not None and not _are_near(cases, near.guides)):
            return
        options: dict[str, Any] = {"near": near, "certify": False, "progress": self._report}
        try:
            mixture = plan_mixture(question.scenario, question.priors, **options)
        except CasswarmError as error:  # a policy may have a success probability all the same
            self._add(failure=str(error))
            return
        if known is None or mixture.value.low > known.value.low:
            self._add(mixture=mixture, failure="")

    def _bound(self, gap: float, limit: float) -> None:
        """Add a bound on the risk of the guide, or on the value of the mixture, if there is one."""
        self._report()
        guide, mixture, question = self.answer.guide, self.answer.mixture, self.answer.question
        assert guide is not None
        if mixture is not None:
            certified = certify_mixture(question.scenario, mixture, gap, limit)
            if certified.value.high < mixture.value.high:
                self._add(mixture=certified)
        if not question.is_known:
            return
        deadline = time.monotonic() + limit
        certificate = certify_guide(question.scenario, guide, gap, deadline)
        if certificate is not None and certificate.risk_bound > (guide.risk_bound or 0.0):
            bounded = replace(guide, risk_bound=certificate.risk_bound, certificate=certificate)
            self._add(guide=bounded)

    def _evaluate(self) -> None:
        """Add runs and bounds of success: a few runs, an enumeration, more runs if it is slow."""
        question, guide = self.answer.question, self.answer.guide
        assert guide is not None
        self._report()
        policy = resolve_policy(question.policy, question.scenario, guide, "auto")
        self._simulate(policy, RUNS[0])
        distribution = self._enumerate(policy)
        self._bound(*BOUND_GAPS[1])
        for runs in RUNS[1:]:
            if distribution.success.width > TOLERANCE:
                self._simulate(policy, runs)

    def _simulate(self, policy: Policy, runs: int) -> None:
        self._report()
        study = simulate(
            self.answer.question.scenario,
            [policy],
            runs,
            guide=self.answer.guide,
            save_trajectories=SAVED_RUNS,
            progress=self._report,
        )
        self._add(study=study)

    def _enumerate(self, policy: Policy) -> OutcomeDistribution:
        """Add bounds of the outcome distribution while they become narrower; return the last."""
        scenario, guide = self.answer.question.scenario, self.answer.guide
        assert guide is not None
        cases = scenario.cases
        max_states = (MAX_STATES if scenario.n <= MAX_MEMBERS else MAX_STATES // 10) // len(cases)
        lattice = Lattice.along(guide, scenario, None, policy.decision_tol)
        options = ExpansionOptions(TOLERANCE, max_states, lattice)
        inputs = scenario, repeated(policy), initial_velocities(scenario, guide), options
        expansions = [StateSpaceExpansion(*inputs, case) for case in range(len(cases))]
        published = time.monotonic()

        def distribution() -> OutcomeDistribution:
            weights = [case.weight for case in cases]
            laws = [expansion.distribution() for expansion in expansions]
            return OutcomeDistribution.of_cases(list(zip(weights, laws, strict=True)))

        def report(*_: object) -> None:
            nonlocal published
            self._interrupt()
            if time.monotonic() > published + _PUBLISH:
                published = time.monotonic()
                self._add(distribution=distribution())

        for expansion in expansions:
            expansion.expand(report)
        last = distribution()
        self._add(distribution=last)
        return last


def is_near(scenario: Scenario, guide: Guide) -> bool:
    """Return True if a search can start from the guide of another scenario."""
    best = guide.best_per_homotopy_class()
    return (
        guide.search == scenario.guide.search == "global"
        and guide.dt == scenario.time.dt
        and bool(best)
        and len(best[0].homotopy) == len(scenario.hazard.after(0).landmarks)
    )


def _are_near(cases: Sequence[Scenario], guides: Sequence[Guide]) -> bool:
    return len(cases) == len(guides) and all(map(is_near, cases, guides))


def _planned_near(scenario: Scenario, previous: Guide) -> Guide | None:
    """A guide like the previous one; None if none arrives."""
    start, initial = scenario.guide_start, scenario.swarm.initial_velocity
    guide = plan_from(scenario, start, near=previous, initial_velocity=initial)
    return guide if guide.arrives else None


GRACE = 2.0
"""Seconds after which work is ended that does not make way for a newer question."""

IDLE = 600.0
"""Seconds after a complete answer until the process ends: a view may go without saying so."""


class Worker:
    """A process that answers the newest question, and drops older ones once their guide is out.

    It starts with the first question, and ends when it is idle. If it dies, the question fails.
    The next question then starts another process.
    `receive` is called with every `Answer`, in a thread of its own.
    """

    def __init__(self, receive: Callable[[Answer], None]) -> None:
        self._receive, self._lock = receive, RLock()
        self._child: Child | None = None
        self._wanted: Question | None = None
        self._latest: Answer | None = None
        self._grace: Timer | None = None  # one of each at a time: questions may come in thousands
        self._idle: Timer | None = None

    def ask(self, question: Question) -> None:
        """Ask a question, which makes all others obsolete; it must be one that can be pickled."""
        content = packed(question)
        with self._lock:
            self._wanted = question
            if self._child is None:
                self._child, self._latest = Child(_answer_questions), None
                self._child.listen(partial(self._take, self._child))
            with suppress(OSError):  # the process has died: the thread that reads will report it
                self._child.send(content)
        self._limit_if_late(question)

    def close(self) -> None:
        """End the process, whatever it does; the next question starts another one."""
        with self._lock:
            child, self._child = self._child, None
            self._latest = self._wanted = None
        if child is not None:
            child.end()

    def _take(self, child: Child, content: bytes) -> None:
        """Pass on an answer, or report that the process ended."""
        answer: Answer | None = pickle.loads(content) if content else None
        with self._lock:
            if child is not self._child or self._wanted is None:
                return
            if answer is None:
                self._child = None
                text = "the process that computes ended unexpectedly; any change starts it again"
                answer = Answer(self._wanted, failure=text, done=True)
            else:
                self._latest = answer
        self._receive(answer)
        if content and answer.done:
            with self._lock:
                if self._idle is not None:
                    self._idle.cancel()
                self._idle = _later(IDLE, self._end_if_idle, answer.question.version)

    def _is_late(self, question: Question) -> bool:
        """Return True if the process works on an older question although its answer is drawn."""
        with self._lock:
            latest = self._latest
            return (
                latest is not None
                and latest.drawn
                and not latest.done
                and latest.question.version < question.version
            )

    def _limit_if_late(self, question: Question) -> None:
        with self._lock:
            if self._grace is None and self._is_late(question):
                self._grace = _later(GRACE, self._restart_if_late, question)

    def _restart_if_late(self, question: Question) -> None:
        with self._lock:
            newest, self._grace = self._wanted, None
            if newest is None:
                return
            if not self._is_late(question):
                self._limit_if_late(newest)
                return
            self.close()
        self.ask(newest)

    def _end_if_idle(self, version: int) -> None:
        with self._lock:
            if self._wanted is not None and self._wanted.version == version:
                self.close()


def _later(seconds: float, function: Callable[..., None], *arguments: object) -> Timer:
    """Call a function in a thread of its own, unless Python ends before."""
    timer = Timer(seconds, function, arguments)
    timer.daemon = True
    timer.start()
    return timer


def _answer_questions(channel: Channel) -> None:
    """Answer questions, in the other process, until this one ends."""

    def poll() -> None:
        if channel.waiting:
            raise Superseded

    previous: Answer | None = None
    for question in channel.requests():
        if channel.waiting:  # for a newer one
            continue
        inquiry = Inquiry(pickle.loads(question), lambda answer: channel.send(packed(answer)), poll)
        with suppress(Superseded):
            inquiry.run(previous)
        previous = inquiry.answer if inquiry.answer.drawn else previous
