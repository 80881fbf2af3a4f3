"""Random scenarios for ``attack.py``, ordinary and extreme, and their symmetric images."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
from _attack_records import Skip

import casswarm as csw

Data = dict[str, Any]
Rng = np.random.Generator


def is_plain(scenario: csw.Scenario) -> bool:
    """Whether value functions treat it."""
    parts, others, swarm = scenario.time.substeps, scenario.target.other, scenario.swarm
    return parts == 1 and not others and swarm.speed == "box" and swarm.kind is None


def policies(scenario: csw.Scenario, horizon: int = 0) -> list[str]:
    """Names of policies that treat a scenario, with a horizon those that plan ahead, too."""
    names = ["naive", "leader", "constrained"]
    if is_plain(scenario):
        names += ["leader-feedback", "constrained-feedback"]
    if horizon and scenario.swarm.speed == "box" and scenario.swarm.kind is None:
        names += [f"leader-mpc-{horizon}", f"constrained-mpc-{horizon}"]
    return names


def draw(
    rng: Rng,
    *,
    members: tuple[int, int] = (1, 4),
    steps: tuple[int, int] = (3, 14),
    extremes: bool = True,
) -> csw.Scenario:
    """Draw a scenario; a refused one is skipped, with the key that is refused.

    Numbers of members and of steps are drawn between the given ones. All lengths are relative to a
    step at full speed, which itself varies over three decades.
    """
    data = _ordinary(rng, int(rng.integers(members[0], members[1] + 1)), steps)
    if extremes and rng.random() < 0.4:
        rng.choice(np.array(EXTREMES, object))(rng, data)
    if rng.random() < 0.2:
        data["hazard"]["zone"] = _zones(rng, data)
    if rng.random() < 0.15:
        data["swarm"]["speed"] = "disc"
    if rng.random() < 0.15:
        data["time"]["substeps"] = int(rng.integers(2, 5))
    if rng.random() < 0.15:
        data["target"]["other"] = [_other_target(rng, data)]
    if rng.random() < 0.2:
        data["success"] = {"arrivals": int(rng.integers(1, len(data["swarm"]["positions"]) + 1))}
    if rng.random() < 0.25:
        data["swarm"] |= _kinds(rng, data["swarm"])
    try:
        return csw.Scenario.from_data(data)
    except csw.ScenarioError as error:
        key = re.sub(r"kinds\.\w+", "kinds", str(getattr(error, "key", "")).partition("[")[0])
        raise Skip(f"scenario refused: {key}") from None


def late(rng: Rng, scenario: csw.Scenario) -> csw.Scenario:
    """The scenario, sometimes with news that are late."""
    if rng.random() < 0.6:
        return scenario
    delay = "never" if rng.random() < 0.2 else int(rng.integers(1, scenario.n_steps + 2))
    return scenario.replace(information={"delay": delay})


def _kinds(rng: Rng, swarm: Data) -> Data:
    """A kind for every member, up to three of them; the first member counts."""
    names = rng.choice(["a", "b", "c"], len(swarm["positions"]))
    tables: dict[str, Data] = {}
    for name in names:
        factors = 10 ** rng.uniform(-1, 1, size=4)
        values = {"exposure": factors[0], "density": factors[1]}
        values |= {"v_max": swarm["v_max"] * factors[2] ** 0.3}
        values |= {"a_max": swarm["a_max"] * factors[3]}
        kept = {key: value for key, value in values.items() if rng.random() < 0.6}
        tables[name] = kept | {"counts": name == names[0] or bool(rng.random() < 0.5)}
    return {"kind": names.tolist(), "kinds": tables}


def as_led(scenario: csw.Scenario) -> csw.Scenario:
    """The scenario of equal members that a guide's agent stands for, from the equations."""
    swarm, table = scenario.swarm, scenario.hazard_table
    if swarm.kind is None:
        return scenario
    kind = swarm.member_kinds[swarm.central_member]
    values: Data = {
        "swarm.kind": None, "swarm.kinds": None, "swarm.v_max": kind.v_max,
        "swarm.a_max": kind.a_max, "guide.margin": scenario.arrival_margin,
        "swarm.positions": scenario.positions[swarm.counting], "success.arrivals": 1,
        "hazard.alpha_1": kind.exposure * table.alpha_1,
        "hazard.alpha_2": kind.density * table.alpha_2,
    }  # fmt: skip
    share = kind.exposure * (1 + table.alpha_2) / (1 + kind.density * table.alpha_2)
    tables = [zone.model_dump(exclude_none=True) for zone in table.zone]
    values["hazard.zone"] = [zone | {"rate": zone["rate"] * share} for zone in tables]
    return scenario.with_values(values)


def limits_of(scenario: csw.Scenario) -> tuple[Any, Any]:
    """v_max and a_max of all members, or where they differ, (n, 1) each."""
    swarm = scenario.swarm
    if swarm.kind is None:
        return swarm.v_max, swarm.a_max
    kinds = swarm.member_kinds
    return np.array([[kind.v_max] for kind in kinds]), np.array([[kind.a_max] for kind in kinds])


def in_time(rng: Rng, scenario: csw.Scenario) -> csw.Scenario:
    """The scenario, or a third of the time one whose radars move, follow paths or switch."""
    if rng.random() > 1 / 3:
        return scenario
    hazard, t_f = scenario.hazard_table, scenario.time.t_f
    unit = scenario.swarm.v_max * 10 ** rng.uniform(-2, 0.3)
    radars = []
    for place, strength in zip(hazard.radars, scenario.hazard.radar_strengths, strict=True):
        radar: Data = {"position": place, "strength": float(strength)}
        if rng.random() < 0.4:
            times = np.sort(rng.uniform(-0.2, 1.2, size=3)) * t_f
            points = place + 0.3 * t_f * unit * rng.normal(size=(3, 2))
            radar = radar | {"path": np.column_stack([times, points]).tolist()}
            del radar["position"]
        elif rng.random() < 0.7:
            radar["velocity"] = (unit * rng.normal(size=2)).tolist()
        if rng.random() < 0.5:
            ends = np.sort(rng.choice(np.arange(2 * scenario.n_steps + 3), 4, replace=False))
            radar["active"] = (ends.reshape(2, 2) * scenario.time.dt / 2).tolist()
        radars.append(radar)
    try:
        return scenario.with_values(
            {"hazard.radars": [], "hazard.strengths": None, "hazard.radar": radars}
        )
    except csw.ScenarioError as error:
        key = str(getattr(error, "key", "")).partition("[")[0]
        raise Skip(f"scenario refused: {key}") from None


def _ordinary(rng: Rng, n: int, between: tuple[int, int]) -> Data:
    steps = int(rng.integers(between[0], between[1] + 1))
    dt, v_max = 10 ** rng.uniform(-1, 0.3), 10 ** rng.uniform(-0.5, 1)
    step = dt * v_max
    offset = np.zeros(2) if rng.random() < 0.7 else rng.normal(size=2) * 10 ** rng.uniform(0, 4)
    angle = rng.uniform(0, 2 * math.pi)
    direction = np.array([math.cos(angle), math.sin(angle)])
    direction /= np.abs(direction).max()
    way = step * steps * rng.uniform(0.3, 0.95) * direction
    length = float(np.hypot(*way))
    spread = step * 10 ** rng.uniform(-2, 0.3)
    data: Data = {
        "name": "attack",
        "swarm": {
            "positions": offset + spread * rng.normal(size=(n, 2)),
            "v_max": v_max,
            "a_max": (v_max * 10 ** rng.uniform(-0.7, 0.5)) ** 2,
            "velocity": "guide",
        },
        "target": {"center": offset + way, "radius": step * 10 ** rng.uniform(-1.3, 0.3)},
        "time": {"dt": dt, "t_f": dt * steps},
        "hazard": _hazard(rng, offset, way, step, dt * steps),
        "guide": _guide(rng),
        "formation": {"rho": (step * 10 ** rng.uniform(-1.5, 0.5)) ** 2},
    }
    kind = rng.random()
    if kind < 0.3:
        data["swarm"]["velocity"] = v_max * rng.uniform(-1, 1, size=2)
    elif kind < 0.5:
        data["swarm"]["velocity"] = 0.9 * v_max * way / max(length, 1e-300)
    return data


def _hazard(rng: Rng, offset: np.ndarray, way: np.ndarray, step: float, t_f: float) -> Data:
    k = int(rng.integers(1, 6))
    length = float(np.hypot(*way))
    across = np.array([-way[1], way[0]]) * rng.normal(scale=0.25, size=(k, 1))
    across[rng.random(k) < 0.2] = 0.0  # on the straight line
    alpha_2 = 0.0 if rng.random() < 0.1 else 10 ** rng.uniform(-1, 1.5)
    risk = 10 ** rng.uniform(-1.5, 0.7)
    hazard: Data = {
        "kind": "saturation",
        "radars": offset + rng.uniform(0.05, 1.1, size=(k, 1)) * way + across,
        "alpha_1": (1 + alpha_2) * risk * (0.3 * length) ** 2 / (t_f * k),
        "alpha_2": alpha_2,
        "alpha_3": (10 ** rng.uniform(-1, 1) / step) ** 2,
    }
    if rng.random() < 0.5:
        hazard["strengths"] = 10 ** rng.uniform(-1, 1, size=k)
    if rng.random() < 0.5:
        hazard["kind"] = "saturation+collision"
        hazard["beta_1"] = step * 10 ** rng.uniform(-1.5, 0)
        hazard["beta_2"] = rng.uniform(1, 8)
    return hazard


def _zones(rng: Rng, data: Data) -> list[Data]:
    """One or two discs or polygons between start and target, of any size, sharp or soft."""
    start, center = np.mean(data["swarm"]["positions"], axis=0), data["target"]["center"]
    way, zones = center - start, []
    length = max(float(np.hypot(*way)), 1e-300)
    for _ in range(int(rng.integers(1, 3))):
        place = start + rng.uniform(0.2, 0.9) * way + rng.normal(size=2) * 0.2 * length
        size = length * 10 ** rng.uniform(-2, -0.5)
        zone: Data = {"center": place, "radius": size}
        if rng.random() < 0.5:
            angles = np.sort(rng.uniform(0, 2 * math.pi, size=int(rng.integers(3, 7))))
            corners = place + size * np.column_stack([np.cos(angles), np.sin(angles)])
            zone = {"vertices": corners[:: rng.choice([-1, 1])]}
        zone["edge"] = size * 10 ** rng.uniform(-1.5, 0.5)
        zone["rate"] = 10 ** rng.uniform(-1.5, 1.5) / data["time"]["dt"]
        zones.append(zone)
    return zones


def _other_target(rng: Rng, data: Data) -> Data:
    """A target zone as far from the start as the first one, in another direction."""
    start, target = np.mean(data["swarm"]["positions"], axis=0), data["target"]
    angle = rng.uniform(0.1, 2 * math.pi - 0.1)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    center = start + rng.uniform(0.5, 1.2) * turn @ (target["center"] - start)
    return {"center": center, "radius": target["radius"] * 10 ** rng.uniform(-0.5, 0.5)}


def _guide(rng: Rng) -> Data:
    guide: Data = {
        "search": "global" if rng.random() < 0.8 else "local",
        "arrival": "any" if rng.random() < 0.7 else "horizon",
        "acceleration_limited": bool(rng.random() < 0.6),
    }
    if rng.random() < 0.3:
        guide["margin"] = 0.0
    return guide


def _far(rng: Rng, data: Data) -> None:
    """The target is barely reachable."""
    positions = np.array(data["swarm"]["positions"])
    start = positions[_central(positions)]
    way = data["target"]["center"] - start
    reach = data["time"]["t_f"] * data["swarm"]["v_max"] * (1 - 10 ** rng.uniform(-12, -2))
    data["target"]["radius"] *= 1e-2
    data["target"]["center"] = start + way / np.abs(way).max() * (reach + data["target"]["radius"])
    data["guide"]["acceleration_limited"] = False


def _central(positions: np.ndarray) -> int:
    return int(np.argmin(np.hypot(*(positions - positions.mean(axis=0)).T)))


def _coincident(_: Rng, data: Data) -> None:
    """All members begin at the same point."""
    data["swarm"]["positions"] = np.repeat(data["swarm"]["positions"][:1], 4, 0)[
        : len(data["swarm"]["positions"])
    ]


def _pair(_: Rng, data: Data) -> None:
    """The last member begins where the first does, and another far away."""
    positions = data["swarm"]["positions"]
    positions[-1] = positions[0]
    if len(positions) > 2:
        positions[1] += 1e3 * (positions[1] - positions[0])


def _inside(rng: Rng, data: Data) -> None:
    """The swarm begins in the target or at its rim."""
    angle, radius = rng.uniform(0, 2 * math.pi), data["target"]["radius"]
    rim = radius * (1 + rng.choice([-1e-3, 0.0, 1e-15, 1e-9, 1e-3]))
    data["target"]["center"] = data["swarm"]["positions"][0] + rim * np.array(
        [math.cos(angle), math.sin(angle)]
    )


def _radar_on_the_line(rng: Rng, data: Data) -> None:
    """A radar stands exactly between start and target, on the target, or near the start."""
    start, center = data["swarm"]["positions"][0], data["target"]["center"]
    data["hazard"]["radars"][0] = start + rng.choice([0.01, 0.5, 1.0]) * (center - start)


def _slow(rng: Rng, data: Data) -> None:
    """All lengths are tiny, or large."""
    scaled = scale_length(data, 10 ** rng.uniform(-4, 4))
    data.clear()
    data.update(scaled)


def _tight(rng: Rng, data: Data) -> None:
    """The acceleration limit or the corridor is very tight, or neither limits."""
    tight = rng.random() < 0.6
    data["swarm"]["a_max"] *= 10 ** (rng.uniform(-6, -2) if tight else rng.uniform(2, 8))
    data["formation"]["rho"] *= 10 ** (rng.uniform(-8, -2) if tight else rng.uniform(2, 6))


def _deadly(rng: Rng, data: Data) -> None:
    """Rates are huge, or vanish."""
    data["hazard"]["alpha_1"] *= 10 ** rng.choice([-8.0, -4.0, 2.0, 4.0])


def _wild(rng: Rng, data: Data) -> None:
    """Protection and collisions reach very far or not at all, or are very strong or weak."""
    for key in sorted({"alpha_2", "alpha_3", "beta_1", "beta_2"} & set(data["hazard"])):
        if rng.random() < 0.6:
            data["hazard"][key] *= 10 ** rng.uniform(-5, 3)


def _remote(rng: Rng, data: Data) -> None:
    """The origin is so far away that positions have few digits."""
    shift = rng.normal(size=2) * 10 ** rng.uniform(4, 8)
    image = moved(data, np.eye(2), shift)
    data.clear()
    data.update(image)


def _clock(rng: Rng, data: Data) -> None:
    """The horizon is not a whole number of steps, or the unit of time is unusual."""
    data["time"]["t_f"] += rng.random() * data["time"]["dt"]
    scaled = scale_time(data, 10 ** rng.uniform(-4, 4))
    data.clear()
    data.update(scaled)


EXTREMES: tuple[Callable[[Rng, Data], None], ...] = (
    _far, _coincident, _pair, _inside, _radar_on_the_line, _slow, _tight, _deadly,
    _wild, _remote, _clock,
)  # fmt: skip


_TABLES = ("hazard", "radar"), ("hazard", "zone"), ("target", "other")
"""Keys of lists of tables."""


def data_of(scenario: csw.Scenario) -> Data:
    """The tables of a scenario, with lists of points as arrays."""
    data = scenario.model_dump(by_alias=True, exclude_none=True)
    data["swarm"]["positions"] = np.array(data["swarm"]["positions"])
    data["hazard"]["radars"] = np.array(data["hazard"]["radars"])
    data["hazard"].pop("parameters", None)
    data["target"]["center"] = np.array(data["target"]["center"])
    for part, key in _TABLES:
        data[part][key] = [
            {name: v if np.isscalar(v) else np.array(v) for name, v in table.items()}
            for table in data[part].get(key, ())
        ]
    if data["swarm"].get("velocity", "guide") != "guide":
        data["swarm"]["velocity"] = np.array(data["swarm"]["velocity"])
    return data


def _multiplied(data: Data, powers: dict[str, float], factor: float) -> Data:
    """The tables with numbers multiplied by powers of a factor, by dotted key."""
    scaled = {key: dict(part) if isinstance(part, dict) else part for key, part in data.items()}
    for key, power in powers.items():
        table, name = key.split(".")
        if isinstance(value := scaled[table].get(name), int | float | np.ndarray):
            scaled[table][name] = value * factor**power
    return scaled


def scale_length(data: Data, factor: float) -> Data:
    """The same scenario in another unit of length."""
    powers = {
        "swarm.positions": 1, "swarm.velocity": 1, "swarm.v_max": 1, "swarm.a_max": 2,
        "target.center": 1, "target.radius": 1, "hazard.radars": 1, "hazard.alpha_1": 2,
        "hazard.alpha_3": -2, "hazard.beta_1": 1, "hazard.core_radius": 1, "guide.a_max": 2,
        "guide.margin": 1, "guide.gamma": -1, "guide.learning_rate": 2, "formation.rho": 2,
        "formation.learning_rate": 2,
    }  # fmt: skip
    return _with_tables(_multiplied(data, powers, factor), (1.0, factor, factor))


def scale_time(data: Data, factor: float) -> Data:
    """The same scenario in another unit of time."""
    powers = {
        "swarm.velocity": -1, "swarm.v_max": -1, "swarm.a_max": -2, "time.dt": 1, "time.t_f": 1,
        "hazard.alpha_1": -1, "guide.a_max": -2, "formation.learning_rate": 1,
    }  # fmt: skip
    if data["hazard"]["kind"] == "saturation+collision":
        powers["hazard.beta_1"] = -1 / data["hazard"]["beta_2"]
    return _with_tables(_multiplied(data, powers, factor), (factor, 1.0, 1.0))


def _with_tables(data: Data, units: tuple[float, float, float]) -> Data:
    """The scenario with radars in time and zones in other units of time, x and y."""
    time, scale = units[0], np.array(units)
    powers: dict[str, object] = {"position": scale[1:], "velocity": scale[1:] / time}
    powers |= {"path": scale, "active": time, "rate": 1 / time}
    powers |= dict.fromkeys(["center", "vertices"], scale[1:])
    powers |= dict.fromkeys(["radius", "edge"], scale[1])
    speeds = {"v_max": scale[1] / time, "a_max": (scale[1] / time) ** 2}
    data["swarm"]["kinds"] = {
        kind: {name: v * speeds[name] if name in speeds else v for name, v in table.items()}
        for kind, table in data["swarm"].get("kinds", {}).items()
    }
    for part, key in _TABLES:
        data[part][key] = [
            {name: v * powers.get(name, 1) for name, v in table.items()}
            for table in data[part].get(key, ())
        ]
    return data


def moved(data: Data, matrix: np.ndarray, shift: np.ndarray) -> Data:
    """The scenario after a signed permutation of the axes (2, 2) and a translation (2,)."""
    image = _multiplied(data, {}, 1.0)
    for table, name in (("swarm", "positions"), ("target", "center"), ("hazard", "radars")):
        image[table][name] = data[table][name].reshape(-1, 2) @ matrix.T + shift
    image["target"]["center"] = image["target"]["center"][0]
    if isinstance(velocity := data["swarm"].get("velocity"), np.ndarray):
        image["swarm"]["velocity"] = velocity @ matrix.T
    for part, key in _TABLES:
        image[part][key] = [_moved(table, matrix, shift) for table in data[part].get(key, ())]
    return image


def _moved(table: Data, matrix: np.ndarray, shift: np.ndarray) -> Data:
    """A radar in time or a zone after a signed permutation and a translation."""
    changed = dict(table)
    for name in table.keys() & {"position", "center", "vertices"}:
        changed[name] = table[name] @ matrix.T + shift
    if "velocity" in table:
        changed["velocity"] = table["velocity"] @ matrix.T
    if "path" in table:
        path = table["path"]
        changed["path"] = np.column_stack([path[:, 0], path[:, 1:] @ matrix.T + shift])
    return changed
