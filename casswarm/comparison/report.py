"""Report of a comparison of solvers as a study: question, answer, set-up, results, sensitivity."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from markupsafe import Markup
from matplotlib.figure import Figure

from .._util.documents import data_uri, figure_uri, render
from .._util.figure_style import literal
from .._util.files import atomic_write
from .._util.text import aligned_table, counted, shortened, wrapped
from ..errors import ComparisonError
from ..nlp.conversion import START
from ..solvers import SOLVERS
from .charts import band_chart, gap_chart, profile_chart, ranking_chart, win_chart
from .families import FAMILIES
from .profiles import (
    RESAMPLES,
    data_profile,
    pairwise_wins,
    performance_bands,
    performance_profile,
    quality_profile,
)
from .ranking import FEWEST, rank_note, sampling_units, sensitivity
from .result import Comparison, saved_tables, typical_problem
from .run import MAX_SOLVES
from .verification import (
    COUNTS,
    SHIFT,
    TESTS,
    by_problem,
    by_solver,
    costs,
    failures,
    groups,
    not_applicable,
    start_text,
)

Drawing = partial[Figure]
"""Function of charts with its arguments, among them `title`; called in the theme of the context."""


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
        Figures by name, to be drawn.
    """

    content: dict[str, Any] = field(repr=False)
    tables: dict[str, pd.DataFrame] = field(repr=False)
    figures: dict[str, Drawing] = field(repr=False)

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
            else figure_uri(draw(), dpi=130, bbox_inches="tight")
            for name, draw in self.figures.items()
        }
        body = Markup(self._rendered("blocks_html.jinja", sources))
        return render("page.html", title="Comparison of solvers", body=body)

    def _rendered(self, blocks: str, sources: Mapping[str, str]) -> str:
        pictures = {
            name: {
                "source": source,
                "alt": self.figures[name].keywords["title"].replace("\\$", "$"),
            }
            for name, source in sources.items()
        }
        return render("comparison.jinja", blocks=blocks, pictures=pictures, **self.content)


def make_report(comparison: Comparison) -> Report:
    """Report of a comparison: question, answer, set-up, results, what would change them."""
    runs, inputs = comparison.runs, comparison.inputs
    tables = report_tables(comparison)
    ratios = runs["time_ratio"].dropna()
    content = {
        "inputs": inputs,
        "tolerances": comparison.tolerances,
        "shift_ms": 1e3 * SHIFT,
        "max_solves": MAX_SOLVES,
        "resamples": RESAMPLES,
        "fewest": FEWEST,
        "answers": [_answer(*group, tables) for group in groups(comparison.runs)],
        "problem_count": len(comparison.problems),
        "run_count": len(runs),
        "false_positives": int(comparison.summary["false_positives"].sum()),
        "time_ratios": (ratios.median(), ratios.quantile(0.9)) if len(ratios) else None,
        "overview": _overview(comparison),
        "families": _families(comparison.problems),
        "notes": _notes(comparison.problems),
        "solvers": pd.DataFrame(
            {
                "solver": name,
                "method": SOLVERS[name].summary if name in SOLVERS else "user-defined",
                "options": options,
            }
            for name, options in inputs["solvers"].items()
        ),
        "not_applicable": not_applicable(runs).to_dict("records"),
        "groups": [
            _group(*group, tables) | {"typical": typical_problem(comparison, *group)}
            for group in groups(comparison.runs)
        ],
        "failures": _failures(tables["failures"], list(inputs["solvers"])),
        "by_problem": _by_problem(tables["problems"]),
    }
    return Report(content, tables, figures(comparison))


def write_report(comparison: Comparison, path: Path) -> None:
    """Write a report as an HTML page or as Markdown: see `Comparison.report`."""
    if path.suffix not in (".html", ".md"):
        message = f"path = {str(path)!r}; allowed: files that end in .html or .md"
        raise ComparisonError(message, key="path", value=str(path))
    report = make_report(comparison)
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".html":
        atomic_write(path, report.html())
        return
    for name, draw in report.figures.items():
        draw().savefig(path.with_name(f"{name}.png"), dpi=130, bbox_inches="tight")
    atomic_write(path, report.markdown())


def comparison_text(comparison: Comparison) -> str:
    """A table for every family and start, in lines of at most 80 characters."""
    texts = []
    summary = comparison.ranking.merge(comparison.summary.drop(columns="mean_ms"))
    for (family, start), part in summary.groupby(["family", "start"], sort=False):
        rows = [
            {
                "solver": str(row["solver"]),
                "solved": percent(row["solved"]),
                "best known": percent(row["best_known"]),
                "mean ms": milliseconds(row["mean_ms"]),
                "95 %": interval(row),
                "rank": f"{row['rank']:g}",
                "probability": percent(row["probability"]),
            }
            for row in part.to_dict("records")
        ]
        notes = [
            f"{row['solver']}: {counted(row['false_positives'], 'false positive')} (reported as "
            "solved, but not verified)"
            for row in part.to_dict("records")
            if row["false_positives"]
        ]
        notes += filter(None, [rank_note(part)])
        problems = counted(int(part["problems"].iloc[0]), "problem")
        title = f"{family}, {start_text(str(start))}, {problems}"
        texts.append("\n".join([title, aligned_table(rows), *notes]))
    return wrapped("\n\n".join(texts))


def report_tables(comparison: Comparison) -> dict[str, pd.DataFrame]:
    """The report's tables by name."""
    runs = comparison.runs
    return {
        **saved_tables(comparison),
        "summary": comparison.summary,
        "ranking": comparison.ranking,
        "sensitivity": sensitivity(runs, float(comparison.inputs["time_limit"])),
        "problems": by_problem(runs),
        "failures": failures(runs),
    }


# --- tables


def _overview(comparison: Comparison) -> pd.DataFrame:
    """Fraction solved and mean time: a row per solver, a column per family and start."""
    table = comparison.summary
    text = table["solved"].map(percent) + ", " + table["mean_ms"].map(milliseconds) + " ms"
    group = table["family"] + ", " + table["start"].replace(START, start_text(START))
    wide = table.assign(text=text, group=group).pivot(
        index="solver", columns="group", values="text"
    )
    wide = wide.reindex(index=list(comparison.inputs["solvers"]), columns=group.unique())
    return wide.fillna("not applicable").reset_index()


def _families(problems: pd.DataFrame) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "family": family,
            "problems": len(part),
            "variables": _between(part["variables"].min(), part["variables"].max()),
            "constraints": _between(part["constraints"].min(), part["constraints"].max()),
            "description": _description(str(family), part),
        }
        for family, part in problems.groupby("family", sort=False)
    )


def _notes(problems: pd.DataFrame) -> list[str]:
    """Paragraphs on how the problems of registered families are made, each once."""
    records = map(FAMILIES.get, problems["family"].unique())
    return list(dict.fromkeys(each.note for each in records if each is not None and each.note))


def _description(family: str, part: pd.DataFrame) -> str:
    """Description of the problems of a family, and the values of their traits."""
    traits = part.drop(columns=["family", "problem", "variables", "constraints"])
    traits = traits.dropna(axis=1, how="all")
    values = [f"{_spaced(str(name))}: {_values(column)}" for name, column in traits.items()]
    record = FAMILIES.get(family)
    known = [] if record is None else [record.description]
    return "; ".join([*filter(None, known), *values]) or "user-defined"


def _values(column: pd.Series) -> str:
    """The different values in a column, in order."""
    distinct = column.dropna().unique()
    return ", ".join(f"{value:g}" if isinstance(value, float) else str(value) for value in distinct)


def _of_group(table: pd.DataFrame, family: str, start: str) -> pd.DataFrame:
    return table[(table["family"] == family) & (table["start"] == start)]


def _answer(family: str, start: str, tables: Mapping[str, pd.DataFrame]) -> str:
    """The fastest and the most reliable solvers of a group, and how sure that is, in words."""
    first, *others = _of_group(tables["ranking"], family, start).to_dict("records")
    text = f"{_heading(family, start)}: {first['solver']} is the fastest, "
    text += f"{milliseconds(first['mean_ms'])} ms on average{interval(first, ' (95 %: {} ms)')}"
    if not others:
        return f"{text}; no other solver is applicable."
    second = others[0]
    text += f", before {second['solver']} with {milliseconds(second['mean_ms'])} ms"
    text += interval(second, " ({} ms)")
    if np.isnan(first["probability"]):
        text += ". So few independent problems say nothing about others."
    else:
        sure = percent(first["probability"])
        text += f". It has the first rank in {sure} of the bootstrap samples of the problems"
        note = rank_note(_of_group(tables["ranking"], family, start))
        text += f" ({note})." if note else "."
    solved = _of_group(tables["summary"], family, start).set_index("solver")["solved"]
    best = ", ".join(solved.index[solved == solved.max()])
    return f"{text} Most often solved, {percent(solved.max())}: {best}."


def _heading(family: str, start: str) -> str:
    return f"{family[:1].upper()}{family[1:]}, {start_text(start)}"


def interval(row: Mapping[Any, Any], form: str = "{}") -> str:
    """Text of the interval of a mean time; empty if there is none."""
    low, high = row["mean_ms_low"], row["mean_ms_high"]
    return form.format(f"{milliseconds(low)} to {milliseconds(high)}") if np.isfinite(low) else ""


def _group(family: str, start: str, tables: Mapping[str, pd.DataFrame]) -> dict[str, Any]:
    ranking = _of_group(tables["ranking"], family, start)
    part = ranking.merge(_of_group(tables["summary"], family, start).drop(columns="mean_ms"))
    best = part.sort_values(["best_known", "solved"], ascending=False, kind="stable").iloc[0]
    changes = _of_group(tables["sensitivity"], family, start)
    return {
        "heading": _heading(family, start),
        "tag": tag(family, start),
        "fastest": part["solver"].iloc[0],
        "pairs": len(part) > 2,
        "rank_note": rank_note(ranking),
        "headline": "Most often at the best known objective: "
        f"{best['solver']}, {percent(best['best_known'])}.",
        "table": pd.DataFrame(
            {
                "rank": part["rank"].map("{:g}".format),
                "solver": part["solver"],
                "probability": part["probability"].map(percent),
                "ranks, 95 %": list(map(_between, part["rank_low"], part["rank_high"])),
                "mean time, ms": part["mean_ms"].map(milliseconds),
                "95 % interval": [interval(row) for row in part.to_dict("records")],
                "build, ms": [_number(value, ".3g") for value in part["build_ms"]],
                "iterations": [_number(value or np.nan, "g") for value in part["iterations"]],
                "evaluations": [_number(value, "g") for value in part["evaluations"]],
            }
        ),
        "verification": pd.DataFrame(
            {"solver": part["solver"]}
            | {_spaced(name): part[name].map(percent) for name in TESTS}
            | {_spaced(name): part[name] for name in COUNTS}
        ),
        "changes": pd.DataFrame(
            {
                "criterion": changes["criterion"],
                "first": changes["first"],
                "probability": changes["probability"].map(percent),
                f"rank of {part['solver'].iloc[0]}": changes["rank"].map("{:g}".format),
            }
        ),
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


def _spaced(name: str) -> str:
    return name.replace("_", " ")


def _between(low: float, high: float) -> str:
    if not np.isfinite(low):
        return ""
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"


def percent(value: float) -> str:
    """Text of a fraction; empty if there is none."""
    return f"{100 * value:.0f} %" if np.isfinite(value) else ""


def milliseconds(value: float) -> str:
    """Text of a time: three digits, without a power of ten."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def _number(value: float, form: str) -> str:
    return format(value, form) if np.isfinite(value) else ""


def _shortened(text: str) -> str:
    return shortened(" ".join(text.split()), 160)


# --- figures: profiles of all families; and of each its ranking, profiles, bands, pairs of solvers,
# and convergence on a typical problem


class _Panel(NamedTuple):
    """A profile, and what its axes show."""

    name: str
    profile: pd.DataFrame
    xlabel: str
    ylabel: str = "fraction of problems"


def figures(comparison: Comparison) -> dict[str, Drawing]:
    """The report's figures by name."""
    drawings = {
        name: drawing
        for family, start in groups(comparison.runs)
        for name, drawing in _group_figures(comparison, family, start)
    }
    return {"overview": overview(comparison), **drawings}


def overview(comparison: Comparison) -> Drawing:
    """Performance profiles of solving, a panel for every family and start."""
    panels = (
        _Panel(
            f"{family}, {start_text(start)}",
            performance_profile(costs(comparison.runs, family, start, "solve_seconds")),
            _FACTOR,
        )
        for family, start in groups(comparison.runs)
    )
    return _profiles(panels, "Performance profiles of solve time", _order(comparison))


def _order(comparison: Comparison) -> tuple[str, ...]:
    """All solvers, by whose order each has the same style in all figures."""
    return tuple(comparison.inputs["solvers"])


def tag(family: str, start: str) -> str:
    """End of the names of a group's figures."""
    return re.sub(r"[^\w.-]", "-", f"{family}-{start}")


def _group_figures(
    comparison: Comparison, family: str, start: str
) -> Iterator[tuple[str, Drawing]]:
    """Figures of a family and a kind of start, each with its name."""
    runs, order, end = comparison.runs, _order(comparison), tag(family, start)
    times = costs(runs, family, start, "solve_seconds")
    group = _title(family, start, times)
    ranking = _of_group(comparison.ranking, family, start)
    yield f"ranking-{end}", partial(ranking_chart, ranking, title=f"{group}: ranks", order=order)
    panels = _panels(comparison, family, start)
    yield f"profiles-{end}", _profiles(panels, f"{group}: profiles", order)
    units = times.set_axis(sampling_units(family, times.index))
    bands = performance_profile(times), performance_bands(units), _FACTOR
    heading = f"{group}: performance profiles with 95 % bands"
    yield f"bands-{end}", partial(band_chart, *bands, title=heading, order=order)
    if len(times.columns) > 2:  # of two, the profiles say it
        heading = f"{group}: fraction of problems on which a solver is faster"
        yield f"wins-{end}", partial(win_chart, pairwise_wins(times), title=heading)
    problem = typical_problem(comparison, family, start)
    if problem is not None:
        history = comparison.convergence(problem, start)
        yield (
            f"convergence-{end}",
            partial(
                gap_chart,
                history.iterates,
                title=f"{literal(problem)}, {start_text(start)}: convergence",
                order=order,
                missing=tuple(history.missing),
            ),
        )


_FACTOR = "factor of the fastest solver's time"


def _panels(comparison: Comparison, family: str, start: str) -> Iterator[_Panel]:
    runs, tolerances = comparison.runs, comparison.tolerances
    seconds = partial(costs, runs, family, start, "solve_seconds")
    name = f"solved, within {tolerances.objective:g} of the best known objective"
    yield _Panel(name, performance_profile(seconds("best_known")), _FACTOR)
    name = f"solved to high accuracy, {tolerances.high_accuracy:g}"
    yield _Panel(name, performance_profile(seconds("high_accuracy")), _FACTOR)
    quality = by_solver(runs, family, start, "quality")
    reached = quality_profile(1e3 * seconds("feasible"), quality)
    yield _Panel("quality within a time", reached, "time in ms", "mean quality")
    budget = data_profile(costs(runs, family, start, "evaluations"))
    name = "solved within a number of evaluations"
    yield _Panel(name, budget, "evaluations of the objective")


def _profiles(panels: Iterable[_Panel], title: str, order: Sequence[str]) -> Drawing:
    """Figure of profiles."""
    names, profiles, below, beside = zip(*panels, strict=True)
    shown = dict(zip(names, profiles, strict=True))
    return partial(profile_chart, shown, below, title=title, order=order, ylabel=beside)


def _title(family: str, start: str, times: pd.DataFrame) -> str:
    number = times.index.nunique()
    copies = len(times) // number - 1
    text = f"{literal(family)}, {start_text(start)}, {counted(number, 'problem')}"
    return f"{text} and {counted(copies, 'copy', 'copies')} of each" if copies else text
