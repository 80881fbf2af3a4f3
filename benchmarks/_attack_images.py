"""Claims about images: changed units, symmetries, orders of members, and files."""

from __future__ import annotations

import pickle
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
from _attack_records import Check, Skip
from _attack_scenarios import (
    Data,
    Rng,
    as_led,
    data_of,
    draw,
    in_time,
    late,
    moved,
    policies,
    scale_length,
    scale_time,
)

import casswarm as csw

_MIRROR = np.array([[1.0, 0.0], [0.0, -1.0]])
_QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])
_NEAR = 1e-6
_LED = 1e-3  # members that meet at one point tie, and the one of lowest index leads
_GAP = 0.05  # of certificates: branch and bound ends at it, and halves regions by the last digit
_TIME_LIMIT = 20.0  # seconds, of plans
_LIMITED = "certificate with a_max"


def images(rng: Rng) -> Iterator[Check]:
    """Claim 7: nothing changes in other units, in an image, or in another order of the members."""
    ordinary = draw(rng, members=(1, 3), steps=(2, 7), extremes=bool(rng.random() < 0.3))
    scenario = late(rng, in_time(rng, ordinary))
    data = data_of(scenario)
    kind = str(rng.choice(["length", "time", "shifted", "mirrored", "turned", "permuted"]))
    if kind == "permuted" and scenario.swarm.counting.sum() < 3:
        raise Skip("one member has one order, and the central of two is the first")
    changed, policy = _image(rng, kind, data), str(rng.choice(policies(scenario)))
    before = _numbers(scenario, policy)
    try:
        after = _numbers(csw.Scenario.from_data(changed), policy)
    except csw.CasswarmError as error:
        if "from 1e-09" in str(error):
            raise Skip("image out of the range of numbers") from None
        yield Check(f"{kind}, refused", np.inf, 0.0, str(error))
        return
    if scenario.hazard_table.kind == "saturation+collision":
        kind += ", collisions"
    for name, value in before.items():
        error = abs(value - after[name])
        detail = f"{name} of {policy}: {value!r} and {after[name]!r}"
        part = "policies" if name == policy else name
        limit = _GAP if name == _LIMITED else _NEAR
        if part == "policies" and kind.startswith("permuted") and policy.startswith("leader"):
            part, limit = "leaders", _LED
        yield Check(f"{kind}, {part}", error, limit, detail)


def _image(rng: Rng, kind: str, data: Data) -> Data:
    extent = float(np.abs(data["swarm"]["positions"] - data["target"]["center"]).max())
    if kind == "length":
        return scale_length(data, 10 ** rng.uniform(-3, 3))
    if kind == "time":
        return scale_time(data, 10 ** rng.uniform(-3, 3))
    if kind == "shifted":
        return moved(data, np.eye(2), rng.normal(size=2) * extent)
    if kind == "mirrored":
        return moved(data, _MIRROR, np.zeros(2))
    if kind == "turned":
        return moved(data, _QUARTER_TURN, np.zeros(2))
    swarm, order = data["swarm"], rng.permutation(len(data["swarm"]["positions"]))
    ordered = {"positions": swarm["positions"][order]}
    if "kind" in swarm:
        ordered["kind"] = [swarm["kind"][row] for row in order]
    return data | {"swarm": swarm | ordered}


def _numbers(scenario: csw.Scenario, policy: str) -> dict[str, float]:
    """Numbers that must not depend on units, axes or order; nothing here may end by the clock."""
    guide = csw.plan(scenario, gap=_GAP, time_limit=_TIME_LIMIT)
    proof = guide.certificate
    if proof is None or guide.survival_bound is None:
        raise Skip("not certified")
    seconds = proof.seconds + (proof.accelerated.seconds if proof.accelerated else 0.0)
    if seconds > _TIME_LIMIT / 2:
        raise Skip("proof takes too long")
    distribution = csw.evaluate(scenario, policy, 1e-7, max_states=100_000, guide=guide)
    if not distribution.complete:
        raise Skip("exact bounds too wide")
    numbers = {
        "guide": guide.survival,
        "certificate": float(np.exp(-proof.bound)),
        _LIMITED: guide.survival_bound,
        "success bound": csw.success_bound(scenario).value,
        policy: distribution.success.low,
    }
    if _barely_reachable(scenario):
        del numbers["certificate"], numbers[_LIMITED]
    return numbers


def _barely_reachable(scenario: csw.Scenario) -> bool:
    """Whether no time is left over: a certificate then depends on the last digits of a path.

    Its multiplier of arrival is ill-conditioned; every multiplier gives a valid bound.
    """
    scenario = as_led(scenario)
    way = np.abs(np.array(scenario.target.center) - scenario.guide_start).max()
    reach = scenario.n_steps * scenario.time.dt * scenario.swarm.v_max
    return bool(way - scenario.target.radius > (1 - 1e-3) * reach)


def files(rng: Rng) -> Iterator[Check]:
    """Claim 9: a scenario read back from a file, or from a pickle, equals the one saved."""
    scenario = draw(rng)
    characters = list("abcß€\"'\\\n\t#=[]{}🙂 \u2028\x7f")
    text = "".join(rng.choice(characters, size=int(rng.integers(0, 12))).tolist())
    with suppress(csw.ScenarioError):  # not every text is allowed
        scenario = scenario.with_values({"description": text})
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "scenario.toml"
            csw.save_scenario(scenario, path, comments=bool(rng.random() < 0.5))
            read = csw.load_scenario(path)
    except csw.CasswarmError as error:
        yield Check("files, TOML", np.inf, 0.0, f"{text!r}: {error}")
        return
    yield Check("files, TOML", float(read != scenario), 0.0, repr(text))
    yield Check("files, hash", float(hash(read) != hash(scenario)), 0.0)
    again = pickle.loads(pickle.dumps(scenario))
    yield Check("files, pickle", float(again != scenario), 0.0)
