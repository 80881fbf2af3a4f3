"""Report of a comparison of solvers: tables, profiles, and how to read them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup
from matplotlib.figure import Figure

from .._util.documents import data_uri, figure_uri, render
from ..figures import pair_chart, profile_chart, win_chart
from ..optimization.solvers import SOLVERS
from .benchmark import MAX_SOLVES
from .problems import DESCRIPTIONS
from .profiles import data_profile, pairwise_profiles, pairwise_wins, performance_profile
from .run import Comparison
from .verification import SHIFT, by_problem, costs, failures, not_applicable


@dataclass(frozen=True, eq=False)
class Report:
    """Report of a comparison, as Markdown or as an HTML page.

    Parameters
    ----------
    content : dict
        Values of the template.
    tables : dict
        The numbers, not rounded, by name.
    figures : dict
        Figures by name.
    """

    content: dict[str, Any] = field(repr=False)
    tables: dict[str, pd.DataFrame] = field(repr=False)
    figures: dict[str, Figure] = field(repr=False)

    def markdown(self, ending: str = "png") -> str:
        """Markdown text that links the figures as NAME.ENDING."""
        sources = {name: f"{name}.{ending}" for name in self.figures}
        text = self._rendered("blocks_markdown.jinja", sources)
        return re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"

    def html(self, images: Mapping[str, bytes] | None = None) -> str:
        """HTML page that contains the figures; `images` are their PNGs by name, if drawn."""
        sources = {
            name: data_uri(images[name], "image/png")
            if images and name in images
            else figure_uri(figure, dpi=130, bbox_inches="tight")
            for name, figure in self.figures.items()
        }
        body = Markup(self._rendered("blocks_html.jinja", sources))
        return render("page.html", title="Comparison of solvers", body=body)

    def _rendered(self, blocks: str, sources: Mapping[str, str]) -> str:
        pictures = {
            name: {
                "source": source,
                "alt": " ".join(self.figures[name].get_suptitle().split()) or name,
            }
            for name, source in sources.items()
        }
        return render("comparison.jinja", blocks=blocks, pictures=pictures, **self.content)


def make_report(comparison: Comparison) -> Report:
    """Report of a comparison: problems, solvers, machine; tables, profiles, failures."""
    runs, inputs = comparison.runs, comparison.inputs
    tables = report_tables(comparison)
    ratios = runs["time_ratio"].dropna()
    content = {
        "inputs": inputs,
        "tolerances": comparison.tolerances,
        "shift_ms": 1e3 * SHIFT,
        "max_solves": MAX_SOLVES,
        "problem_count": len(comparison.problems),
        "run_count": len(runs),
        "false_positives": int(comparison.summary["false_positives"].sum()),
        "time_ratios": (ratios.median(), ratios.quantile(0.9)) if len(ratios) else None,
        "overview": _overview(comparison),
        "families": _families(comparison.problems),
        "random": bool(comparison.problems["family"].isin(list(DESCRIPTIONS)).any()),
        "solvers": pd.DataFrame(
            [
                {
                    "solver": name,
                    "method": SOLVERS[name].summary if name in SOLVERS else "user-defined",
                    "options": options,
                }
                for name, options in inputs["solvers"].items()
            ]
        ),
        "not_applicable": not_applicable(runs).to_dict("records"),
        "groups": [_group(*group) for group in _groups(comparison)],
        "failures": _failures(tables["failures"], list(inputs["solvers"])),
        "by_problem": _by_problem(tables["problems"]),
    }
    return Report(content, tables, figures(comparison))


def report_tables(comparison: Comparison) -> dict[str, pd.DataFrame]:
    """The report's tables by name."""
    runs = comparison.runs
    return {
        "runs": runs,
        "summary": comparison.summary,
        "problems": by_problem(runs),
        "failures": failures(runs),
    }


def figures(comparison: Comparison) -> dict[str, Figure]:
    """The report's figures by name."""
    return {
        name: figure
        for group in _groups(comparison)
        for name, figure in _group_figures(comparison, *group)
    }


def _groups(comparison: Comparison) -> Iterator[tuple[str, str, pd.DataFrame]]:
    """Families and starts, each with its part of the summary."""
    for (family, start), part in comparison.summary.groupby(["family", "start"], sort=False):
        yield str(family), str(start), part


def _tag(family: str, start: str) -> str:
    return re.sub(r"[^\w.-]", "-", f"{family}-{start}")


# --- figures


def _group_figures(
    comparison: Comparison, family: str, start: str, part: pd.DataFrame
) -> Iterator[tuple[str, Figure]]:
    runs, order, tag = comparison.runs, list(comparison.inputs["solvers"]), _tag(family, start)
    number = int(part["problems"].iloc[0])
    title = f"{family}, {start} start, {number} problem{'s' if number > 1 else ''}"
    times = costs(runs, family, start, "solve_seconds")
    best_times = costs(runs, family, start, "solve_seconds", "best_known")
    best_label = (
        f"solved, and within {comparison.tolerances.objective:g} of the best known objective"
    )
    profiles = {
        "solved (reported and verified)": performance_profile(times),
        best_label: performance_profile(best_times),
    }
    label = "factor of the fastest solver's time"
    heading = f"{title}: performance profiles of solve time"
    yield f"profile-{tag}", profile_chart(profiles, label, heading, order)

    group = runs[(runs["family"] == family) & (runs["start"] == start)]
    units = group.groupby("problem")["gradient_seconds"].median().reindex(times.index)
    profiles = {
        "evaluations of the objective": data_profile(costs(runs, family, start, "evaluations")),
        "time, in evaluations of objective and gradient": data_profile(times, units.to_numpy()),
    }
    yield f"data-{tag}", profile_chart(profiles, "budget", f"{title}: data profiles", order)

    if len(times.columns) > 1:
        best = _fastest(part)
        pairs = {pair: p for pair, p in pairwise_profiles(times).items() if best in pair}
        yield f"pairs-{tag}", pair_chart(pairs, f"{title}: {best} and every other solver", order)
        heading = f"{title}: fraction of problems on which a solver is faster"
        yield f"wins-{tag}", win_chart(pairwise_wins(times), heading)


# --- tables


def _overview(comparison: Comparison) -> pd.DataFrame:
    """Fraction solved and mean time: a row per solver, a column per family and start."""
    table = comparison.summary
    text = table["solved"].map(_percent) + ", " + table["mean_ms"].map(_ms) + " ms"
    group = table["family"] + ", " + table["start"]
    wide = table.assign(text=text, group=group).pivot(
        index="solver", columns="group", values="text"
    )
    wide = wide.reindex(index=list(comparison.inputs["solvers"]), columns=group.unique())
    return wide.fillna("not applicable").reset_index()


def _families(problems: pd.DataFrame) -> pd.DataFrame:
    return pd.DataFrame(
        [
            {
                "family": family,
                "problems": len(part),
                "variables": _range(part["variables"]),
                "constraints": _range(part["constraints"]),
                "description": _description(str(family), part),
            }
            for family, part in problems.groupby("family", sort=False)
        ]
    )


def _description(family: str, part: pd.DataFrame) -> str:
    """What the problems of a family are, and the values of their traits."""
    traits = part.dropna(axis=1, how="all").drop(
        columns=["family", "problem", "variables", "constraints"]
    )
    values = [f"{_spaced(str(name))}: {_values(column)}" for name, column in traits.items()]
    known = [DESCRIPTIONS[family]] if family in DESCRIPTIONS else []
    return "; ".join([*known, *values]) or "user-defined"


def _values(column: pd.Series) -> str:
    """The different values in a column, in order."""
    distinct = column.dropna().unique()
    return ", ".join(f"{value:g}" if isinstance(value, float) else str(value) for value in distinct)


def _group(family: str, start: str, part: pd.DataFrame) -> dict[str, Any]:
    fastest, best = _fastest(part), part.sort_values(["best_known", "solved"], ascending=False)
    solved, mean = part.loc[part["solver"] == fastest, ["solved", "mean_ms"]].iloc[0]
    verification = ["solver", "true_positives", "false_positives", "missed", "unsolved"]
    return {
        "heading": f"{family.capitalize()}, {start} start",
        "tag": _tag(family, start),
        "fastest": fastest,
        "pairs": len(part) > 1,
        "headline": f"Least mean time: {fastest}, {_ms(mean)} ms, with {_percent(solved)} solved. "
        f"Most often at the best known objective: {best['solver'].iloc[0]}, "
        f"{_percent(best['best_known'].iloc[0])}.",
        "table": pd.DataFrame(
            {
                "solver": part["solver"],
                "solved": part["solved"].map(_percent),
                "best known": part["best_known"].map(_percent),
                "mean time, ms": part["mean_ms"].map(_ms),
                "build, ms": [_number(value, ".3g") for value in part["build_ms"]],
                "iterations": [_number(value or np.nan, "g") for value in part["iterations"]],
                "evaluations": [_number(value, "g") for value in part["evaluations"]],
            }
        ),
        "verification": part[verification].rename(columns=_spaced),
    }


def _failures(table: pd.DataFrame, solvers: list[str]) -> pd.DataFrame | None:
    if table.empty:
        return None
    shown = table[["solver", "family", "start", "runs", "example", "reason"]]
    shown = shown.sort_values("solver", key=lambda names: names.map(solvers.index), kind="stable")
    return shown.assign(reason=shown["reason"].map(_shortened))


def _by_problem(table: pd.DataFrame) -> pd.DataFrame:
    shown = table.drop(columns="family").assign(
        best_objective=[f"{value:.6g}" for value in table["best_objective"]],
        largest_gap=[_number(value, ".1e") for value in table["largest_gap"]],
        fastest_ms=[_number(value, ".3g") for value in table["fastest_ms"]],
    )
    return shown.rename(columns={"fastest_ms": "ms"}).rename(columns=_spaced)


def _fastest(part: pd.DataFrame) -> str:
    return str(part.sort_values("mean_ms")["solver"].iloc[0])


def _range(column: pd.Series) -> str:
    low, high = column.min(), column.max()
    return f"{low}" if low == high else f"{low} to {high}"


def _spaced(name: str) -> str:
    return name.replace("_", " ")


def _percent(value: float) -> str:
    return f"{100 * value:.0f} %"


def _ms(value: float) -> str:
    """Three digits, without a power of ten."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def _number(value: float, form: str) -> str:
    return format(value, form) if np.isfinite(value) else ""


def _shortened(text: str, length: int = 160) -> str:
    line = " ".join(text.split())
    return line if len(line) <= length else f"{line[: length - 3]}..."
