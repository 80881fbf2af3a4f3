"""A simulation as one page: tables, figures, inputs, and how to make it again. It loads nothing."""

from __future__ import annotations

import base64
import io
import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import pandas as pd
from matplotlib import rc_context
from matplotlib.figure import Figure

from .._util.documents import render
from ..figures import theme
from ..planning.bounds.success_bound import SuccessBound
from . import catalogue
from .folder import Saved

CAPTIONS = {
    "success": "Success probability of every policy. Bars: share of runs in which some member "
    "reached the target alive; lines: 95 % intervals (Wilson).",
    "differences": "Differences in success between policies, from the same random numbers run by "
    "run; lines: 95 % intervals (Newcombe). Where a line crosses zero, the runs do not tell which "
    "is better.",
    "guide": "The guide, over the rate of a lone member. Where the members keep within a corridor, "
    "it is around the guide's points.",
    "run": "The way of one run, over the rate of a lone member. Members often share a path: the "
    "first is drawn widest. Crosses: where members were destroyed, with their numbers.",
    "formation": "The same run close up. Shades: the rate that one more member would have, given "
    "the others, as a share of a lone member's: the lighter, the better they protect. Members that "
    "stand together share a label.",
}


@dataclass(frozen=True)
class Picture:
    """A figure as an address that holds it, its size in CSS pixels, and how to read it."""

    name: str
    address: str
    width: int
    height: int
    caption: str


def simulation_page(
    saved: Saved, run: int = 0, progress: Callable[[str], object] = lambda _: None
) -> str:
    """The page of a folder that casswarm simulate left, as HTML.

    Parameters
    ----------
    saved : Saved
    run : int
        Which of the kept runs is shown.
    progress : callable
        Called with the name of every figure.

    Raises
    ------
    CheckpointError
        The folder lacks a table, or was left by another command.
    """
    saved.trace(run=run)  # says so, where that is no simulation
    record, summary = saved.record, saved.table("summary")
    drawn = {**saved.figures(run), **catalogue.plan_figures(saved.scenario, saved.guide)}
    pictures = {}
    with theme("page"):
        for name, draw in drawn.items():
            progress(name)
            pictures[name] = picture(name, draw())
    paired = saved.table("paired") if saved.has("paired.csv") else pd.DataFrame()
    best = summary.sort_values("success", ascending=False).to_dict("records")[0]
    return render(
        "simulation.html",
        scenario=saved.scenario,
        best=best,
        policies=list(summary["policy"]),
        runs=int(summary["runs"].min()),
        summary=summary_rows(summary),
        paired=paired_rows(paired),
        failures=int(summary["solver_failures"].sum()),
        infeasible=int(summary["infeasible"].sum()),
        guide=saved.guide,
        bound=success_bound_of(record["result"].get("success_bound")),
        pictures=pictures,
        run=run,
        command=f"casswarm {shlex.join(map(str, record['arguments']))}",
        text=record["scenario"],
        record=record,
    )


def success_bound_of(told: Mapping[str, Any] | None) -> SuccessBound | None:
    """The bound of a record; None where there is none."""
    if told is None:
        return None
    return SuccessBound(float(told["failure"]), tuple(told["risks"]), str(told["reason"]))


def picture(name: str, figure: Figure) -> Picture:
    """A figure as an SVG within its address; letters as outlines, for fonts differ."""
    buffer = io.BytesIO()
    with rc_context({"svg.hashsalt": "casswarm", "svg.fonttype": "path"}):
        figure.savefig(buffer, format="svg", dpi=110, metadata={"Date": None})
    data = base64.b64encode(buffer.getvalue()).decode()
    width, height = (round(96 * inches) for inches in figure.get_size_inches())
    kind = name if name in CAPTIONS else name.split("-")[0]
    return Picture(name, f"data:image/svg+xml;base64,{data}", width, height, CAPTIONS[kind])


def summary_rows(summary: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows of the table of policies as texts by the heads of their columns."""
    return [
        {
            "policy": row["policy"],
            "runs": f"{row['runs']:,}",
            "success": f"{row['success']:.4f}" if row["successes"] else "none",
            "95 % interval": f"{row['success_low']:.4f} to {row['success_high']:.4f}",
            "survivors": f"{row['survivors_mean']:.2f}",
            "arrival step": f"{row['arrival_step_mean']:.1f}" if row["successes"] else "–",
            "infeasible": f"{row['infeasible']:,}",
            "solver failures": f"{row['solver_failures']:,}",
            "fallbacks": f"{row['fallbacks']:,}",
            "saturated": f"{row['saturated']:,}",
        }
        for row in summary.to_dict("records")
    ]


def paired_rows(paired: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows of the table of differences as texts by the heads of their columns."""
    return [
        {
            "difference in success": f"{row['first']} − {row['second']}",
            "": f"{row['difference']:+.4f}",
            "95 % interval": f"{row['difference_low']:+.4f} to {row['difference_high']:+.4f}",
            "discordant runs": f"{row['first_only']} : {row['second_only']}",
            "p, McNemar": f"{row['p_value']:.2g}",
        }
        for row in paired.to_dict("records")
    ]
