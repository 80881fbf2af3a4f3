"""What a comparison of solvers showed, for somebody who was not there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from ..figures import pair_chart, profile_chart, win_chart
from .profiles import data_profile, pairwise_profiles, pairwise_wins, performance_profile
from .rendering import Block, Heading, Picture, Table, Text, html, markdown
from .run import Comparison
from .setting import rules, setting
from .verification import by_problem, costs, failures

REFERENCES = (
    "E. D. Dolan, J. J. Moré, Benchmarking optimization software with performance profiles, "
    "Math. Program. 91 (2002) 201-213",
    "J. J. Moré, S. M. Wild, Benchmarking derivative-free optimization algorithms, "
    "SIAM J. Optim. 20 (2009) 172-191",
    "N. Gould, J. Scott, A note on performance profiles for benchmarking software, "
    "ACM Trans. Math. Software 43 (2016) 15",
)


@dataclass(frozen=True, eq=False)
class Report:
    """Blocks of text, tables and figures, in order."""

    blocks: tuple[Block, ...]
    tables: dict[str, pd.DataFrame]
    """The numbers, not rounded, by name."""

    @property
    def figures(self) -> dict[str, Figure]:
        """Figures by name."""
        return {b.name: b.figure for b in self.blocks if isinstance(b, Picture)}

    def markdown(self, ending: str = "png") -> str:
        """Markdown text that links the figures as NAME.ENDING."""
        return markdown(self.blocks, ending)

    def html(self, images: Mapping[str, bytes] | None = None) -> str:
        """One HTML page with the figures in it; `images` are their PNGs by name, if drawn."""
        return html(self.blocks, images)


def make_report(comparison: Comparison) -> Report:
    """Report of a comparison: what was solved, by what, where; tables, profiles, failures."""
    title, *described = setting(comparison)
    blocks = [title, *_in_short(comparison), *described, *rules(comparison)]
    for family, start in _groups(comparison):
        blocks += _group(comparison, family, start)
    blocks += [*_failures(comparison), *_problems(comparison)]
    blocks += [Heading("References"), *(Text(f"{reference}.") for reference in REFERENCES)]
    tables = {
        "cells": comparison.cells,
        "summary": comparison.summary,
        "problems": by_problem(comparison.cells),
        "failures": failures(comparison.cells),
    }
    return Report(tuple(blocks), tables)


def pictures(comparison: Comparison) -> dict[str, Figure]:
    """The report's figures by name; the traits of the problems are not needed for them."""
    blocks = [block for group in _groups(comparison) for block in _group(comparison, *group)]
    return {block.name: block.figure for block in blocks if isinstance(block, Picture)}


def _groups(comparison: Comparison) -> list[tuple[str, str]]:
    table = comparison.summary[["family", "start"]].drop_duplicates()
    return [(str(family), str(start)) for family, start in table.itertuples(index=False)]


def _in_short(comparison: Comparison) -> Iterator[Block]:
    """What was solved how fast, a row a solver, and the limits of what that says."""
    table = comparison.summary
    yield Heading("In short")
    rows = []
    for solver in comparison.inputs["solvers"]:
        row = {"solver": solver}
        for family, start in _groups(comparison):
            part = table[(table["family"] == family) & (table["start"] == start)]
            one = part[part["solver"] == solver]
            row[f"{family}, {start}"] = (
                f"{100 * one['solved'].iloc[0]:.0f} %, {_ms(one['mean_ms'].iloc[0])} ms"
                if len(one)
                else "takes none"
            )
        rows.append(row)
    yield Table(pd.DataFrame(rows))
    lies = int(table["said_not_true"].sum())
    yield Text(
        "Share of problems solved, and mean time with failures counted at the limit of "
        f"{comparison.inputs['seconds']:g} s, by family and start. "
        + (
            "No solver called solved what was not. "
            if not lies
            else f"In {lies} cells a solver called solved what was not: see Failures. "
        )
        + "What counts as solved is said below. The numbers are those of the options below, on "
        "these problems and this machine; a solver that fails here may be the right one elsewhere."
    )


def _group(comparison: Comparison, family: str, start: str) -> Iterator[Block]:
    summary = comparison.summary
    part = summary[(summary["family"] == family) & (summary["start"] == start)]
    order = list(comparison.inputs["solvers"])
    number = int(part["problems"].iloc[0])
    title = f"{family}, {start} start, {number} problem{'s' if number > 1 else ''}"
    tag = f"{family}-{start}".replace(" ", "-")
    yield Heading(f"{family.capitalize()}, {start} start")
    yield Text(_headline(part))
    yield Table(_rounded(part))
    yield Text(
        "How often a solver's word was true, in numbers of problems: one that says solved when the "
        "residuals say otherwise misleads; one that solves and does not say so wastes its work."
    )
    yield Table(_truth(part))
    times = {
        wanted: costs(comparison.cells, family, start, "solve_seconds", wanted)
        for wanted in ("solved", "found")
    }
    yield Picture(
        f"profile-{tag}",
        profile_chart(
            {
                "solved (said, and true)": performance_profile(times["solved"]),
                f"solved, and within {comparison.tolerances.objective:g} of the best known "
                "objective": performance_profile(times["found"]),
            },
            "factor of the fastest solver's time",
            f"{title}: performance profiles of solve time",
            order,
        ),
        "Performance profiles (Dolan and Moré): at 1, how often a solver is the fastest; at a "
        "factor, how often it needs at most that many times the fastest one's time; at the right "
        "end, how often it solves the problem at all.",
    )
    yield _budgets(comparison, family, start, title, tag, order)
    yield from _pairs(times["solved"], part, title, tag, order)


def _budgets(
    comparison: Comparison, family: str, start: str, title: str, tag: str, order: list[str]
) -> Picture:
    cells = comparison.cells
    group = cells[(cells["family"] == family) & (cells["start"] == start)]
    seconds = costs(cells, family, start, "solve_seconds")
    units = group.groupby("problem")["gradient_seconds"].median().reindex(seconds.index)
    return Picture(
        f"data-{tag}",
        profile_chart(
            {
                "evaluations of the objective": data_profile(
                    costs(cells, family, start, "evaluations")
                ),
                "time, in evaluations of objective and gradient": data_profile(
                    seconds, units.to_numpy()
                ),
            },
            "budget",
            f"{title}: data profiles",
            order,
        ),
        "Data profiles (after Moré and Wild): how many problems are solved within a budget, "
        "whoever else takes part. Left, evaluations of the objective as the solver counts them; "
        "right, time in units of what one evaluation of the objective and its gradient takes in "
        "CasADi, so that compiled solvers can need less than one for each.",
    )


def _pairs(
    times: pd.DataFrame, part: pd.DataFrame, title: str, tag: str, order: list[str]
) -> Iterator[Block]:
    if len(times.columns) < 2:
        return
    best = str(part.sort_values("mean_ms")["solver"].iloc[0])
    pairs = {pair: profile for pair, profile in pairwise_profiles(times).items() if best in pair}
    yield Picture(
        f"pairs-{tag}",
        pair_chart(pairs, f"{title}: {best} and every other solver", order),
        "Profiles of two solvers alone. In a profile of many, only the best curve can be read "
        "against the others: the order of the rest can change with who takes part (Gould and "
        f"Scott). {best} has the least mean time.",
    )
    yield Picture(
        f"wins-{tag}",
        win_chart(pairwise_wins(times), f"{title}: who is faster than whom"),
        "Share of problems in which the solver of the row is faster than that of the column; to "
        "solve is faster than to fail. A row and column pair that adds up to less than 100 % has "
        "problems that both fail on.",
    )


def _failures(comparison: Comparison) -> Iterator[Block]:
    table = failures(comparison.cells)
    yield Heading("Failures")
    if table.empty:
        yield Text("None.")
        return
    yield Text(
        "Every cell that was taken and not solved, by solver and reason, with an example. A reason "
        "is the status and the solver's own words, or what the residuals say against them."
    )
    shown = table[["solver", "family", "start", "cells", "example", "reason"]]
    order = {name: number for number, name in enumerate(comparison.inputs["solvers"])}
    shown = shown.sort_values("solver", key=lambda names: names.map(order), kind="stable")
    yield Table(shown.assign(reason=[_short(reason) for reason in shown["reason"]]))


def _problems(comparison: Comparison) -> Iterator[Block]:
    table = by_problem(comparison.cells)
    yield Heading("Every problem")
    yield Text(
        "How many solvers took it, solved it and found the best known objective; the largest "
        "relative gap of a solved answer, which is another local minimum where it is large; and "
        "who was the fastest."
    )
    yield Table(
        pd.DataFrame(
            {
                "problem": table["problem"],
                "start": table["start"],
                "taken": table["taken"],
                "solved": table["solved"],
                "found": table["found"],
                "best known": [f"{value:.6g}" for value in table["best"]],
                "largest gap": [_number(value, ".1e") for value in table["worst_gap"]],
                "fastest": table["fastest"],
                "ms": [_number(value, ".3g") for value in table["fastest_ms"]],
            }
        )
    )


def _headline(part: pd.DataFrame) -> str:
    fastest = part.sort_values("mean_ms").iloc[0]
    most = part.sort_values(["found", "solved"], ascending=False).iloc[0]
    return (
        f"Least mean time: {fastest['solver']}, {_ms(fastest['mean_ms'])} ms, with "
        f"{100 * fastest['solved']:.0f} % solved. Most often at the best known objective: "
        f"{most['solver']}, {100 * most['found']:.0f} %."
    )


def _rounded(part: pd.DataFrame) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "solver": part["solver"],
            "solved": [f"{100 * value:.0f} %" for value in part["solved"]],
            "best known": [f"{100 * value:.0f} %" for value in part["found"]],
            "mean time, ms": [_ms(value) for value in part["mean_ms"]],
            "build, ms": [_number(value, ".3g") for value in part["build_ms"]],
            "iterations": [_number(value or np.nan, "g") for value in part["iterations"]],
            "evaluations": [_number(value, "g") for value in part["evaluations"]],
        }
    )


def _truth(part: pd.DataFrame) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "solver": part["solver"],
            "said, true": part["said_and_true"],
            "said, not true": part["said_not_true"],
            "not said, true": part["true_not_said"],
            "neither": part["neither"],
        }
    )


def _ms(value: float) -> str:
    """Three digits, without a power of ten."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def _number(value: float, form: str) -> str:
    return format(value, form) if np.isfinite(value) else ""


def _short(text: str, most: int = 160) -> str:
    line = " ".join(text.split())
    return line if len(line) <= most else f"{line[: most - 3]}..."
