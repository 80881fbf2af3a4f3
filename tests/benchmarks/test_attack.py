"""The random search for violated claims: claims hold on a few draws, and false ones are found."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def attack(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(FOLDER))
    import attack

    yield attack
    for name in [name for name in sys.modules if name == "attack" or name.startswith("_attack")]:
        del sys.modules[name]


CLIMBED, PAIRS = "success, climbed plans", "success, pairs"
SLOW = [("joint", 10, 1, ""), ("risk", 20, 10, ""), ("success", 100, 50, PAIRS)]
SLOW += [("images", 20, 10, ""), ("mixtures", 20, 6, ""), ("success", 29, 3, PAIRS)]
SLOW += [("mixtures", 13, 1, ""), ("risk", 11, 1, "")]
CLAIMS = [("success", 109, 1, CLIMBED)]
CLAIMS += [("success", 35, 1, PAIRS), ("success", 113, 1, CLIMBED)]
CLAIMS += [(claim, 10, 1, "") for claim in ("enumeration", "limits", "files")]


@pytest.mark.parametrize(
    ("claim", "seed", "draws", "part"),
    [*CLAIMS, *(pytest.param(*row, marks=pytest.mark.slow) for row in SLOW)],
)
def test_claim_on_fixed_draws_holds(
    attack: Any, claim: str, seed: int, draws: int, part: str
) -> None:
    record = attack.search([claim], seed=seed, draws=draws)[claim]
    assert record.draws == draws
    assert sum(tally.checks for tally in record.parts.values()) > 0
    assert record.violations == 0
    assert not part or record.parts[part].checks > 0
    if part and draws > 10:  # the bounds are not just 1
        assert min(record.parts[name].worst for name in (CLIMBED, PAIRS)) > -0.1


def test_false_claims_are_found(
    attack: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def false(_: object) -> Iterator[object]:
        yield attack.Check("right", 0.0)
        yield attack.Check("wrong", 1.0)
        yield attack.Check("undefined", float("nan"))
        yield from [attack.Trial("coverage", number % 2 == 0) for number in range(100)]
        raise ZeroDivisionError

    monkeypatch.setitem(attack.CLAIMS, "false", false)
    records = attack.search(["false"], seed=3, draws=1)
    assert attack.report(records) == 4
    assert "--replay false 3" in capsys.readouterr().out


def test_draws_with_the_same_seed_are_equal(attack: Any) -> None:
    from _attack_scenarios import draw

    first, second = (draw(attack.np.random.default_rng([1, 2])) for _ in range(2))
    assert first == second
