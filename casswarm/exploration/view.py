"""A view of a session: parameters, changes that it sends, and what it draws, as JSON.

The widget and the local page have the same JavaScript (``static/view.js``). A message to it has
the parts of what it draws that have changed.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from threading import RLock
from typing import TYPE_CHECKING, Any

from ..errors import CasswarmError, ScenarioError
from ..guide.guide import Guide
from ..policies.named import POLICIES
from ..scenario.validation import field_of
from ..scenario.variations import value
from ..studies.simulation import Study
from ..typing import Interval
from .answers import Answer, HazardMap
from .radar_points import radar_points
from .session import POINTS, Session

if TYPE_CHECKING:
    from ..scenario import Scenario
    from ..scenario.radars import Radar


FACTOR = 4.0
"""Ratio of the ends of a slider to the value that the session starts with."""

MAX_MEMBERS = 12
"""Largest number of members of a slider, unless the scenario has more."""

SLIDERS = (
    "n",
    "swarm.v_max",
    "swarm.a_max",
    "target.radius",
    "time.t_f",
    "hazard.alpha_1",
    "hazard.alpha_2",
    "hazard.alpha_3",
    "hazard.beta_1",
    "hazard.beta_2",
    "guide.a_max",
    "formation.rho",
    "information.delay",
)
LARGEST_N = 1000
"""Largest number of members that a page may ask for, unless the scenario has more."""

AMBIGUITY = "ambiguity"
"""Key of the slider of `Session.ambiguity`, for a hazard that is not known."""

_AMBIGUITY_TEXT = (
    "Priors for which guides are mixed: 0 is the prior of the scenario, 1 all priors, the worst "
    "case; between, those at most twice this number from the prior, in the sum of all differences."
)

CHOICES = {"guide.search": ("local", "global"), "guide.arrival": ("any", "horizon")}


@dataclass(frozen=True)
class Parameter:
    """A number with a slider, by `step` or, without one, on a logarithmic scale.

    Its key is that of `casswarm.sweep`, or `AMBIGUITY`.
    """

    key: str
    low: float
    high: float
    step: float | None
    description: str


def parameters(scenario: Scenario) -> list[Parameter]:
    """Parameters of the scenario that are numbers, with ranges around their values."""
    listed = []
    if len(scenario.cases) > 1:
        listed.append(Parameter(AMBIGUITY, 0, 1, 0.01, _AMBIGUITY_TEXT))
    for key in SLIDERS:
        number, field = value(scenario, key), field_of(key, type(scenario))
        description = (field and field.description) or ""
        if key == "n" and scenario.swarm.kind is not None:
            continue  # members differ: their number is not one to slide
        if key == "n":
            most = max(MAX_MEMBERS, scenario.n)
            listed.append(Parameter(key, 1, most, 1, "Number of members."))
        elif key == "information.delay":
            listed.append(Parameter(key, 0, scenario.n_steps, 1, description))
        elif number:  # neither missing nor 0, which has no range
            low, high = float(number) / FACTOR, float(number) * FACTOR
            listed.append(Parameter(key, low, high, None, description))
    return listed


def _shown(session: Session, key: str) -> Any:
    """Value of a slider; news that never come are as late as the run is long."""
    if key == AMBIGUITY:
        return session.ambiguity
    late = key == "information.delay" and session.scenario.delay is None
    return session.scenario.n_steps if late else value(session.scenario, key)


Message = dict[str, Any]

_UNSUPPORTED = "the page sent something unknown; load it again"


class View:
    """One widget or page of a session, to which `send` sends messages, from any thread."""

    def __init__(self, session: Session, send: Callable[[Message], None]) -> None:
        self._session, self._send = session, send
        self._sent: dict[str, object] = {}
        self._end: Callable[[], None] | None = None
        self._pages, self._lock = 0, RLock()

    def open(self) -> None:
        """Send everything to another page, and from now on every change."""
        with self._lock:
            self._pages += 1
            self._sent.clear()
        if self._end is None:
            self._end = self._session.subscribe(self._show)
        self._show()

    def close(self) -> None:
        """Send nothing any more if this is the last page."""
        self._pages = max(0, self._pages - 1)
        if self._end is not None and not self._pages:
            self._end()
            self._end = None

    def receive(self, message: Any) -> None:
        """Do what a message of the page says, and confirm its number."""
        try:
            self._actions[message["type"]](message)
        except CasswarmError as error:
            self._send({"notice": str(error)})
        except (LookupError, TypeError, ValueError, ArithmeticError):  # inf as an index, 10**400
            self._send({"notice": _UNSUPPORTED})
        if isinstance(message, dict) and isinstance(message.get("number"), int):
            self._send({"handled": message["number"]})

    @property
    def _actions(self) -> dict[str, Callable[[Mapping[str, Any]], object]]:
        session = self._session
        return {
            "open": lambda _: self.open(),
            "close": lambda _: self.close(),
            "move": self._move,
            "change": self._change,
            "policy": lambda m: session.choose_policy(m["name"]),
            "undo": lambda _: session.undo(),
            "redo": lambda _: session.redo(),
            "reset": lambda _: session.reset(),
            "copy": lambda _: self._send({"toml": session.scenario.to_toml()}),
            "save": lambda _: self._send({"notice": f"saved as {session.save()}"}),
        }

    def _change(self, message: Mapping[str, Any]) -> None:
        """Change what the page shows, and nothing else of the scenario."""
        key, number = message["key"], message["value"]
        if key == AMBIGUITY:
            self._session.choose_ambiguity(number, message.get("gesture"))
            return
        if key not in SLIDERS and key not in CHOICES:
            raise ValueError(key)
        most = max(LARGEST_N, self._session.history.first.scenario.n)
        if key == "n" and not number <= most:  # more would take long, and much memory
            raise ScenarioError(f"n = {number:g}; allowed here: whole numbers from 1 to {most}")
        self._session.change({key: number}, message.get("gesture"))

    def _move(self, message: Mapping[str, Any]) -> None:
        x, y = message["position"]
        index = int(message["index"])
        if message["point"] not in POINTS or index < 0:
            raise ValueError(message["point"])
        position = (float(x), float(y))
        self._session.move(message["point"], index, position, message.get("gesture"))

    def _show(self) -> None:
        """Send the parts that have changed since they were sent."""
        with self._lock:
            message: Message = {}
            for name, (token, part) in _parts(self._session).items():
                if name not in self._sent or not _same(self._sent[name], token):
                    self._sent[name] = token
                    message[name] = part()
            if message:
                self._send(message)


def _same(first: object, second: object) -> bool:
    """Return True if tokens are the same objects, or equal plain values."""
    if isinstance(first, tuple) and isinstance(second, tuple):
        return all(map(_same, first, second))
    plain = isinstance(first, str | int | bool | None)
    return first == second if plain else first is second


def _parts(session: Session) -> dict[str, tuple[object, Callable[[], Any]]]:
    """Parts of a page, by name: the token of its state, and the function that makes it."""
    present, good = session.answer, session.last_good
    history = session.history
    state = (history.present, history.can_undo, history.can_redo)
    failure = "" if present is None else present.failure
    problem, busy = session.problem or failure, present is None or not present.done
    parts: dict[str, tuple[object, Callable[[], Any]]] = {
        "scene": (state, partial(_scene, session)),
        "problem": (problem, lambda: problem),
        "busy": (busy, lambda: busy),
    }
    if good is None:
        return parts
    question, mixed = good.question, session.last_mixed
    current = question.scenario == session.scenario
    evaluated = current and question.policy == session.policy
    guide, hazard_map, outcomes = good.guide, good.hazard_map, (good.study, good.distribution)
    assert guide is not None
    assert hazard_map is not None
    parts["guide"] = ((guide, current), partial(_guide, guide, current))
    if mixed is not None:
        asked = (mixed.question.scenario, mixed.question.ambiguity)
        mixable = asked == (session.scenario, session.ambiguity)
        parts["mixture"] = ((mixed.mixture, mixable), partial(_mixture, mixed, mixable))
    parts["map"] = (hazard_map, partial(_map, hazard_map))
    parts["success"] = ((*outcomes, evaluated), partial(_success, good, evaluated))
    parts["runs"] = (good.study, partial(_runs, good.study))
    return parts


def _scene(session: Session) -> Message:
    scenario = session.scenario
    points, tables = radar_points(scenario), [c.scenario.hazard_table for c in scenario.cases]
    zones = list(dict.fromkeys(zone for table in tables for zone in table.regions))
    listed = parameters(session.history.first.scenario)
    return {
        "revision": session.revision,
        "name": scenario.name,
        "members": scenario.swarm.positions,
        "kinds": scenario.swarm.kind or [],
        "counting": scenario.swarm.counting.tolist(),
        "radars": [point.position for point in points],
        "cases": [point.cases for point in points],
        "clouds": [point.cloud for point in points],
        "prior": [case.weight for case in scenario.cases],
        "tracks": [_track(scenario, point.table) for point in points],
        "zones": [{"vertices": zone.vertices, "radius": zone.radius} for zone in zones],
        "others": [{"vertices": [d.center], "radius": d.radius} for d in scenario.target.other],
        "target": {"center": scenario.target.center, "radius": scenario.target.radius},
        "parameters": [asdict(item) | {"value": _shown(session, item.key)} for item in listed],
        "choices": [
            {"key": key, "values": values, "value": value(scenario, key)}
            for key, values in CHOICES.items()
        ],
        "steps": scenario.n_steps,
        "policy": session.policy,
        "policies": POLICIES,
        "can_undo": session.history.can_undo,
        "can_redo": session.history.can_redo,
    }


def _track(scenario: Scenario, radar: Radar | None) -> list[tuple[float, ...]] | None:
    """Position and strength of a radar at every step; None if it does not move or switch."""
    if radar is None or not radar.changes:
        return None
    times = [step * scenario.time.dt for step in range(scenario.n_steps + 1)]
    return [(*radar.track.position_at(time), radar.track.strength_at(time)) for time in times]


def _guide(guide: Guide, current: bool) -> Message:
    return {
        "positions": guide.positions.tolist(),
        "arrival": guide.arrival,
        "survival": guide.survival,
        "bound": guide.survival_bound,
        "current": current,
    }


def _mixture(answer: Answer, current: bool) -> Message:
    mixture = answer.mixture
    assert mixture is not None
    return {
        "paths": [path.positions.tolist() for path in mixture.paths],
        "weights": mixture.weights.tolist(),
        "ambiguity": str(mixture.ambiguity),
        "low": mixture.value.low,
        "high": mixture.value.high,
        "pure": mixture.pure_value,
        "known": mixture.known_value,
        "worst_prior": mixture.worst_prior.tolist(),
        "survivals": mixture.survival.tolist(),
        "note": mixture.note,
        "current": current,
    }


def _map(hazard_map: HazardMap) -> Message:
    shades = [base64.b64encode(each.tobytes()).decode() for each in hazard_map.shades]
    size = hazard_map.shades.shape[1]
    return {
        "low": hazard_map.low.tolist(),
        "high": hazard_map.high.tolist(),
        "frame": dict(zip(("low", "high"), hazard_map.frame.tolist(), strict=True)),
        "size": size,
        "shades": shades,
    }


def _success(answer: Answer, current: bool) -> Message | None:
    if answer.success is None:
        return None
    (low, high), proven = answer.success
    return {
        "low": low,
        "high": high,
        "proven": proven,
        "runs": 0 if answer.study is None else len(answer.study.runs),
        "policy": answer.question.policy,
        "by_case": _success_by_case(answer),
        "current": current,
    }


def _success_by_case(answer: Answer) -> list[Interval]:
    """Proven bounds of the success in every case; empty if the hazard is known."""
    law = answer.distribution
    return [] if law is None else [each.success for _, each in law.cases]


def _runs(study: Study | None) -> list[Message]:
    """Trajectories of the saved runs."""
    if study is None:
        return []
    (trajectories,) = study.trajectories.values()
    parts = ("positions", "alive", "leaders", "ghosts")
    return [{part: getattr(run, part).tolist() for part in parts} for run in trajectories]
