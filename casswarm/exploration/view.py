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
from .answers import Answer, HazardMap
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

CHOICES = {"guide.search": ("local", "global"), "guide.arrival": ("any", "horizon")}


@dataclass(frozen=True)
class Parameter:
    """A number with a slider, on a logarithmic scale unless it is whole.

    Its key is that of `casswarm.sweep`.
    """

    key: str
    low: float
    high: float
    whole: bool
    description: str


def parameters(scenario: Scenario) -> list[Parameter]:
    """Parameters of the scenario that are numbers, with ranges around their values."""
    listed = []
    for key in SLIDERS:
        number, field = value(scenario, key), field_of(key, type(scenario))
        description = (field and field.description) or ""
        if key == "n" and scenario.swarm.kind is not None:
            continue  # members differ: their number is not one to slide
        if key == "n":
            most = max(MAX_MEMBERS, scenario.n)
            listed.append(Parameter(key, 1, most, True, "Number of members."))
        elif key == "information.delay":
            listed.append(Parameter(key, 0, scenario.n_steps, True, description))
        elif number:  # neither missing nor 0, which has no range
            low, high = float(number) / FACTOR, float(number) * FACTOR
            listed.append(Parameter(key, low, high, False, description))
    return listed


def _shown(scenario: Scenario, key: str) -> Any:
    """Value of a slider; news that never come are as late as the run is long."""
    late = key == "information.delay" and scenario.delay is None
    return scenario.n_steps if late else value(scenario, key)


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
    state = (session.scenario, session.policy, history.can_undo, history.can_redo)
    failure = "" if present is None else present.failure
    problem, busy = session.problem or failure, present is None or not present.done
    parts: dict[str, tuple[object, Callable[[], Any]]] = {
        "scene": (state, partial(_scene, session)),
        "problem": (problem, lambda: problem),
        "busy": (busy, lambda: busy),
    }
    if good is None:
        return parts
    current = good.question.scenario == session.scenario
    evaluated = current and good.question.policy == session.policy
    guide, hazard_map, outcomes = good.guide, good.hazard_map, (good.study, good.distribution)
    assert guide is not None
    assert hazard_map is not None
    parts["guide"] = ((guide, current), partial(_guide, guide, current))
    parts["map"] = (hazard_map, partial(_map, hazard_map))
    parts["success"] = ((*outcomes, evaluated), partial(_success, good, evaluated))
    parts["runs"] = (good.study, partial(_runs, good.study))
    return parts


def _scene(session: Session) -> Message:
    scenario = session.scenario
    table = scenario.hazard_table
    strengths = table.strengths or [1.0] * len(table.radars)
    listed = parameters(session.history.first.scenario)
    return {
        "revision": session.revision,
        "name": scenario.name,
        "members": scenario.swarm.positions,
        "kinds": scenario.swarm.kind or [],
        "counting": scenario.swarm.counting.tolist(),
        "radars": table.starts,
        "strengths": [*strengths, *(radar.strength for radar in table.radar)],
        "tracks": [None] * len(table.radars) + [_track(scenario, each) for each in table.radar],
        "zones": [{"vertices": z.vertices, "radius": z.radius} for z in table.regions],
        "others": [{"vertices": [d.center], "radius": d.radius} for d in scenario.target.other],
        "target": {"center": scenario.target.center, "radius": scenario.target.radius},
        "parameters": [asdict(item) | {"value": _shown(scenario, item.key)} for item in listed],
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


def _track(scenario: Scenario, radar: Radar) -> list[tuple[float, ...]] | None:
    """Position and strength of a radar at every step; None if it does not move or switch."""
    if not radar.changes:
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
        "current": current,
    }


def _runs(study: Study | None) -> list[Message]:
    """Trajectories of the saved runs."""
    if study is None:
        return []
    (trajectories,) = study.trajectories.values()
    parts = ("positions", "alive", "leaders", "ghosts")
    return [{part: getattr(run, part).tolist() for part in parts} for run in trajectories]
