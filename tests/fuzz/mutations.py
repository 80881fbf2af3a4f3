"""Mutations: of data by its structure, of a scenario by its meaning, of files by their bytes."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from random import Random
from typing import Any

from oddities import long_value, odd_number, odd_text, odd_value

Place = tuple[Any, Any]
"""A table or list, and the key or index of an element."""


# --- nested data


def places(data: Any) -> Iterator[Place]:
    """Every element of nested tables and lists, with what holds it."""
    items = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in list(items):
        yield data, key
        if isinstance(value, dict | list) and value:
            yield from places(value)


def mutated(data: Any, rng: Random) -> Any:
    """Copy of nested data with one to three elements changed."""
    data = copy.deepcopy(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        known = list(places(data))
        if known:
            place = rng.choice(known)
            change = rng.choices(list(_CHANGES), list(_CHANGES.values()))[0]
            change(data, *place, rng)
    return data


def _replace(data: Any, holder: Any, key: Any, rng: Random) -> None:  # noqa: ARG001
    holder[key] = odd_value(rng)


def _scale(data: Any, holder: Any, key: Any, rng: Random) -> None:  # noqa: ARG001
    value = holder[key]
    if isinstance(value, int | float):
        holder[key] = rng.choice((-1, 0.5, 2, 10.0 ** rng.randint(-25, 25))) * min(value, 1e300)
    else:
        holder[key] = odd_number(rng)


def _delete(data: Any, holder: Any, key: Any, rng: Random) -> None:  # noqa: ARG001
    del holder[key]


def _rename(data: Any, holder: Any, key: Any, rng: Random) -> None:  # noqa: ARG001
    if isinstance(holder, dict):
        renamed = (key[:-1], key.upper(), key + "_", f"{key}.{key}", odd_text(rng))
        holder[rng.choice(renamed)] = holder.pop(key)
    else:
        holder.insert(rng.randint(0, len(holder)), holder[key])


def _swap(data: Any, holder: Any, key: Any, rng: Random) -> None:
    other, name = rng.choice(list(places(data)))
    holder[key], other[name] = copy.deepcopy(other[name]), copy.deepcopy(holder[key])


def _wrap(data: Any, holder: Any, key: Any, rng: Random) -> None:  # noqa: ARG001
    value = holder[key]
    holder[key] = rng.choice(([value], {"value": value}, [value] * 3, str(value), [value, [value]]))


def _lengthen(data: Any, holder: Any, key: Any, rng: Random) -> None:  # noqa: ARG001
    value = holder[key]
    if isinstance(value, list) and value:
        holder[key] = value * rng.choice((2, 10, 300))
    else:
        holder[key] = long_value(rng)


_CHANGES = {_replace: 5, _scale: 5, _delete: 2, _rename: 1, _swap: 1, _wrap: 1, _lengthen: 1}
"""Changes of an element, with how often each is drawn."""


# --- scenarios


def mutated_scenario(data: dict[str, Any], rng: Random) -> dict[str, Any]:
    """Copy of a scenario's data, changed by its structure or by its meaning."""
    if rng.random() < 0.5:
        changed: dict[str, Any] = mutated(data, rng)
        return changed
    data, changes = copy.deepcopy(data), (_coincide, _into_target, _in_other_units, _on_radar)
    for _ in range(rng.choice((1, 1, 2))):
        rng.choice((*changes, _extreme_limits))(data, rng)
    return data


def _near(point: list[float], rng: Random) -> list[float]:
    offset = rng.choice((0.0, 0.0, 1e-300, 1e-17, 1e-9, 1e-3, 0.1))
    return [point[0] + offset, point[1]]


def _tables(data: dict[str, Any]) -> list[dict[str, Any]]:
    """Radars that move or switch."""
    tables: list[dict[str, Any]] = data["hazard"].get("radar", [])
    return tables


def _lists_of_points(data: dict[str, Any]) -> list[list[list[float]]]:
    """Positions of members, and of radars at rest where there are any, also in cases."""
    tables = [data["hazard"], *data["hazard"].get("case", ())]
    radars = [table["radars"] for table in tables if table.get("radars")]
    return [data["swarm"]["positions"], *radars]


def _coincide(data: dict[str, Any], rng: Random) -> None:
    """Put members, or radars, onto each other."""
    points = rng.choice(_lists_of_points(data))
    for _ in range(rng.randint(1, 5)):
        points.insert(0, _near(rng.choice(points), rng))


def _into_target(data: dict[str, Any], rng: Random) -> None:
    """Put a member or a radar into the target zone, or onto its edge."""
    points = rng.choice(_lists_of_points(data))
    x, y = data["target"]["center"]
    edge = rng.choice((0.0, 1.0, 1 - 1e-16, 1 + 1e-9)) * data["target"]["radius"]
    points[rng.randrange(len(points))] = _near([x + edge, y], rng)


def _on_radar(data: dict[str, Any], rng: Random) -> None:
    """Put a member or the target onto a radar, or just outside its core."""
    moving = [radar.get("position") or radar["path"][0][1:] for radar in _tables(data)]
    at_rest = [point for points in _lists_of_points(data)[1:] for point in points]
    radar = rng.choice([*at_rest, *moving])
    core = data["target"]["radius"] / 50
    place = [radar[0] + rng.choice((0.0, core, core * (1 + 1e-9))), radar[1]]
    if rng.random() < 0.5:
        data["target"]["center"] = place
    else:
        positions = data["swarm"]["positions"]
        positions[rng.randrange(len(positions))] = place


def _in_other_units(data: dict[str, Any], rng: Random) -> None:
    """Express lengths, or times, in units that are very large or very small."""
    factor = 10.0 ** rng.choice((-22, -18, -12, -6, 6, 9, 12, 18, 22))
    if rng.random() < 0.4:
        data["time"] = {key: value * factor for key, value in data["time"].items()}
        data["swarm"]["v_max"] /= factor
        data["swarm"]["a_max"] /= factor**2
        for radar in _tables(data):
            _scale_radar(radar, 1.0, factor)
        return
    for radar in _tables(data):
        _scale_radar(radar, factor, 1.0)
    for points in _lists_of_points(data):
        points[:] = [[x * factor, y * factor] for x, y in points]
    data["target"]["center"] = [value * factor for value in data["target"]["center"]]
    data["target"]["radius"] *= factor
    data["swarm"]["v_max"] *= factor
    data["swarm"]["a_max"] *= factor**2


def _scale_radar(radar: dict[str, Any], length: float, time: float) -> None:
    """Express a radar that moves or switches in other units."""
    if "position" in radar:
        radar["position"] = [x * length for x in radar["position"]]
    if "velocity" in radar:
        radar["velocity"] = [x * length / time for x in radar["velocity"]]
    if "path" in radar:
        radar["path"] = [[t * time, x * length, y * length] for t, x, y in radar["path"]]
    if "active" in radar:
        radar["active"] = [[t * time for t in interval] for interval in radar["active"]]


def _extreme_limits(data: dict[str, Any], rng: Random) -> None:
    """Make a limit or a rate tight, loose or absurd."""
    table, key = rng.choice(_LIMITS).split(".")
    data.setdefault(table, {})[key] = 10.0 ** rng.choice((-20, -9, -3, -1, 0, 1, 3, 9, 20))


_LIMITS = (
    *("swarm.v_max", "swarm.a_max", "target.radius", "time.dt", "time.t_f"),
    *("hazard.alpha_1", "hazard.alpha_2", "hazard.alpha_3", "hazard.core_radius"),
    *("guide.margin", "guide.a_max", "formation.rho"),
)


# --- files


def mutated_bytes(content: bytes, rng: Random) -> bytes:
    """A file's content, damaged as disks, editors and attackers do."""
    return rng.choice(_DAMAGES)(content, rng)


def _cut(content: bytes, rng: Random) -> bytes:
    return content[: rng.randint(0, len(content))]


def _flipped(content: bytes, rng: Random) -> bytes:
    data = bytearray(content or b"x")
    for _ in range(rng.choice((1, 3, 30))):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(data)


def _inserted(content: bytes, rng: Random) -> bytes:
    at = rng.randint(0, len(content))
    odd = (b"\0", b"\xff\xfe", b"\xc3", b"\xed\xa0\x80", b"\x1b[2J", b"\xef\xbb\xbf", b'"""', b"#")
    return content[:at] + rng.choice(odd) + content[at:]


def _lines_shuffled(content: bytes, rng: Random) -> bytes:
    lines = content.splitlines(keepends=True)
    for _ in range(rng.randint(1, 3)):
        at = rng.randrange(len(lines)) if lines else 0
        lines[at : at + 1] = rng.choice(([], lines[at : at + 1] * 2, lines[at : at + 1] * 500))
    return b"".join(lines)


def _recoded(content: bytes, rng: Random) -> bytes:
    text = content.decode(errors="replace")
    return rng.choice(
        (
            b"\xef\xbb\xbf" + content,
            content.replace(b"\n", b"\r\n"),
            content.replace(b"\n", b"\r"),
            text.encode("utf-16"),
            text.replace("e", "é").encode("latin-1", errors="replace"),
            b"",
            b"\n" * 1000,
        )
    )


def _nested(content: bytes, rng: Random) -> bytes:
    depth = rng.choice((200, 5_000, 100_000))
    opened = rng.choice((b"x = " + b"[" * depth, b"x = " + b"{a=" * depth, b"[" * depth))
    dotted = b".".join([b"k"] * rng.choice((100, 900))) + b" = 1\n"
    return rng.choice((opened, dotted + content, b"[" + dotted[:-5] + b"]\n" + content))


def _huge(content: bytes, rng: Random) -> bytes:
    size = rng.choice((100_000, 1_000_000, 4_000_000))
    return rng.choice(
        (
            content + b"# " + b"x" * size,
            b"x = " + b"9" * size + b"\n" + content,
            b'description = "' + b"y" * size + b'"\n' + content,
            b"z = [" + b"1," * (size // 10) + b"]\n" + content,
        )
    )


_DAMAGES = (_cut, _flipped, _flipped, _inserted, _lines_shuffled, _recoded, _nested, _huge)
