"""The leaderboard: success of policies in the built-in scenarios, and the bound of all policies.

Run with the installed package::

    python benchmarks/leaderboard.py                     # all rows, some quarters of an hour
    python benchmarks/leaderboard.py barricade           # the rows of a scenario
    python benchmarks/leaderboard.py barricade leader    # one row, which is only printed
    python benchmarks/leaderboard.py barricade module:policy    # your row among the kept ones

In the last form, `policy` is a function of a scenario and a guide that returns a policy.

Rows are kept in results/leaderboard/leaderboard.csv and written to docs/leaderboard.md.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

import pandas as pd
from _timing import timed
from policies import RUNS, WIDE
from train_policy import trained

import casswarm as csw
from casswarm import Guide, Scenario
from casswarm._util.numbers import rounded_up

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "results" / "leaderboard" / "leaderboard.csv"
PAGE = ROOT / "docs" / "leaderboard.md"
LEARNERS = TABLE.with_name("learners.csv")
ENTRIES = TABLE.with_name("entries")

POLICIES = ("naive", "constrained", "leader", "joint", "joint-replanning")
TRAINED = ("alley", "barricade")
"""Scenarios in which a policy is trained, which takes minutes."""

MAX_PLANNED = 10  # members of whom all paths are planned at once
STATES = 20_000

HEADER = """\
# Leaderboard

Success of policies in the built-in scenarios, best first. `trained` is the policy of
[policy gradients](measured-environments.md#a-trained-policy); the others are
[described here](policies.md). `python benchmarks/leaderboard.py barricade module:function` prints
the rows of a scenario with that of a policy of your own, which the function returns for a scenario
and a guide. An entry of your own, of a policy or a solver, is [a manifest](#entries).

- **Success**: proven bounds at most {wide} apart, or (~) an interval with 95 % confidence, for
  which the probable states are enumerated and the rest is sampled by {runs} runs.
- **Bound**: no policy exceeds it (`success_bound`, rounded up).
- **Regret**: (bound - success) / bound, with the lower end of the success: the score. It is never
  below 0, and its least value is not known where the bound is not reached.
- **Time**: CPU seconds until the policy is ready, guide, plan and training included, measured
  beside other work.
- **Command**: prints the row again. `python benchmarks/leaderboard.py` makes all rows,
  [leaderboard.csv](../results/leaderboard/leaderboard.csv), and this page.
"""
LEARNED = f"""\
## Learners

Three implementations of proximal policy optimisation learn, in the
[environments](envs.md), what is added to the velocity towards the guide: 150,000 steps, five seeds,
the same settings in all scenarios (`python benchmarks/learners.py`). `guided` is the policy without
training. Success is the lower end of proven bounds, or of an interval with 95 % confidence from
{RUNS} runs, where states are too many; median, least and largest of the seeds. Time is CPU seconds.
In `gauntlet` all learners are far above `guided`; in the other two none is, in so few steps.

| scenario | learner | success, median | least to largest | regret | time, s |
| --- | --- | --- | --- | --- | --- |"""
MANIFESTS = """\
## Entries

A policy or a solver takes part by a manifest of ten lines. One command measures what it claims:
`python benchmarks/entries.py MANIFEST...`. `source` names a function of a scenario and a guide, or
a solver's class; claims are least values, of the success in scenarios, or of the fraction of a
family's problems that are solved. The manifests of these entries are in
`results/leaderboard/entries`, where yours can be proposed:
"""
COLUMNS = ("policy", "success", "bound", "regret", "time, s", "command")


def make_policy(name: str, scenario: Scenario, guide: Guide) -> Any:
    """The policy of a row."""
    if ":" in name:
        return csw.as_policy(own_function(name, Path.cwd())(scenario, guide))
    return trained(scenario, guide) if name == "trained" else csw.make_policy(name, scenario, guide)


def own_function(name: str, folder: Path) -> Any:
    """The function of "module:function", of a module in a folder or an installed one."""
    module, _, function = name.partition(":")
    try:
        sys.path.insert(0, str(folder))
        return getattr(importlib.import_module(module), function)
    except (ImportError, AttributeError, ValueError) as error:
        raise SystemExit(f"{name}: {error}; expected module:function") from None


def own_rows(scenario: Scenario, name: str) -> str:
    """The rows of a scenario with that of a policy of one's own, best first."""
    kept = pd.read_csv(TABLE)
    own = pd.DataFrame([measured(scenario, name)])
    rows = pd.concat([kept[kept["scenario"] == scenario.name], own])
    ranked = rows.sort_values(["success_low", "policy"], ascending=[False, True])
    return "\n".join(markdown_row(row) for row in ranked.to_dict("records"))


def names_of(scenario: Scenario) -> list[str]:
    """Policies of a scenario's rows."""
    if len(scenario.cases) > 1 or scenario.hazard.changes:  # which not all policies treat
        return []
    names = [name for name in POLICIES if scenario.n <= MAX_PLANNED or "joint" not in name]
    return names + (["trained"] if scenario.name in TRAINED else [])


def measured(scenario: Scenario, name: str) -> dict[str, Any]:
    """A row of the table."""
    guide, _, planned = timed(lambda: csw.plan(scenario))
    ready = timed(lambda: make_policy(name, scenario, guide))
    found = success_of(scenario, ready.result, guide)
    seconds = round(planned + ready.cpu, 1)
    return {"scenario": scenario.name, "policy": name, **found, "seconds": seconds}


def success_of(scenario: Scenario, policy: Any, guide: Guide) -> dict[str, Any]:
    """Ends of a policy's success, whether they are proven bounds, and the bound of all policies."""
    low, high = csw.evaluate(scenario, policy, max_states=STATES, guide=guide).success
    exact = high - low <= WIDE
    if not exact:
        low, high = csw.estimate(scenario, policy, RUNS, guide=guide).success
    return {
        "success_low": round(low, 6),
        "success_high": rounded_up(high, 6),
        "exact": exact,
        "bound": rounded_up(csw.success_bound(scenario).value, 6),
    }


def success_text(row: dict[str, Any]) -> str:
    """What `success_of` found, in a table."""
    success = f"{row['success_low']:.4f} to {row['success_high']:.4f}"
    return success if row["exact"] else f"~ {success}"


def regret(row: Any) -> Any:
    """Score of a row, or of a table of rows: (bound - success) / bound."""
    return 1.0 - row["success_low"] / row["bound"]


def command(row: dict[str, Any]) -> str:
    """What prints a row again."""
    return f"python benchmarks/leaderboard.py {row['scenario']} {row['policy']}"


def markdown_row(row: dict[str, Any]) -> str:
    """A row of the page."""
    cells = (
        row["policy"],
        success_text(row),
        f"{row['bound']:.4f}",
        f"{regret(row):.3f}",
        f"{row['seconds']:.1f}",
        f"`{command(row)}`",
    )
    return f"| {' | '.join(cells)} |"


def page(table: pd.DataFrame) -> str:
    """Text of docs/leaderboard.md."""
    parts = [HEADER.format(wide=WIDE, runs=RUNS)]
    for name, rows in table.groupby("scenario"):
        ranked = rows.sort_values(["success_low", "policy"], ascending=[False, True])
        lines = [markdown_row(row) for row in ranked.to_dict("records")]
        head = f"| {' | '.join(COLUMNS)} |\n|{' --- |' * len(COLUMNS)}"
        parts.append("\n".join([f"## {name}\n", head, *lines, ""]))
    return "\n".join([*parts, learners(pd.read_csv(LEARNERS)), entries()])


def learners(table: pd.DataFrame) -> str:
    """The page's section of policies that were trained in the environments."""
    lines = []
    for (scenario, name), rows in table.groupby(["scenario", "learner"]):
        low, score = rows["success_low"], regret(rows).median()
        ends = f"{low.median():.3f} | {low.min():.3f} to {low.max():.3f}"
        seconds = rows["seconds"].median()
        lines.append(f"| {scenario} | {name} | {ends} | {score:.3f} | {seconds:.0f} |")
    return "\n".join([LEARNED, *lines, ""])


def entries() -> str:
    """The page's section of manifests, with one of them."""
    paths = sorted(ENTRIES.glob("*.toml"))
    text = paths[-1].read_text(encoding="utf-8")
    names = "\n".join(f"- [{path.stem}](../{path.relative_to(ROOT).as_posix()})" for path in paths)
    return f"{MANIFESTS}\n{names}\n\n```toml\n{text}```\n"


def renew(scenario: Scenario) -> None:
    """Measure the rows of a scenario, and write the table and the page with them."""
    rows = []
    for policy in names_of(scenario):
        rows.append(measured(scenario, policy))
        print(scenario.name, markdown_row(rows[-1]), flush=True)
    table = pd.DataFrame(rows)
    if TABLE.exists():
        kept = pd.read_csv(TABLE)
        table = pd.concat([kept[kept["scenario"] != scenario.name], table])
    TABLE.parent.mkdir(parents=True, exist_ok=True)
    table = table.sort_values("scenario", kind="stable")
    table.to_csv(TABLE, index=False)
    PAGE.write_text(page(table), encoding="utf-8")


def main() -> None:
    """Print a row, or make the rows of a scenario or of all, and the page."""
    names = sys.argv[1:2] or list(csw.builtin_scenarios())
    if len(sys.argv) > 3 or names[0] not in csw.builtin_scenarios():
        raise SystemExit(
            f"usage: leaderboard.py [SCENARIO [POLICY]]; got {' '.join(sys.argv[1:])}; "
            f"scenarios: {', '.join(csw.builtin_scenarios())}"
        )
    scenarios = [csw.load_scenario(name) for name in names]
    if len(sys.argv) == 3 and ":" in sys.argv[2]:
        own_function(sys.argv[2], Path.cwd())  # before the measurements
        print(own_rows(scenarios[0], sys.argv[2]))
        return
    if len(sys.argv) == 3:
        if sys.argv[2] not in names_of(scenarios[0]):
            raise SystemExit(
                f"unknown policy {sys.argv[2]}; known: {', '.join(names_of(scenarios[0]))}"
            )
        print(markdown_row(measured(scenarios[0], sys.argv[2])))
        return
    for scenario in scenarios:
        renew(scenario)


if __name__ == "__main__":
    main()
