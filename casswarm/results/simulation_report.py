"""A simulation as one self-contained HTML page: tables, figures, inputs, how to repeat it."""

from __future__ import annotations

import shlex
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure

from .._util.documents import figure_uri, render
from ..figures import theme
from ..studies.tables import count_notes, paired_texts, summary_texts
from . import catalogue
from .folder import ResultsFolder


def simulation_page(folder: ResultsFolder) -> str:
    """HTML page of a folder that casswarm simulate wrote, with the first run of every policy.

    Raises
    ------
    CheckpointError
        The folder lacks a table, or was written by another command.
    """
    folder.trajectory()  # raises for other commands
    record, summary = folder.record, folder.table("summary")
    scenario, guide = folder.scenario, folder.guide
    figures = {**folder.figures(), **catalogue.plan_figures(scenario, guide)}
    with theme("page"):
        pictures = {name: _picture(draw()) for name, draw in figures.items()}
    best = summary.sort_values("success", ascending=False).to_dict("records")[0]
    return render(
        "simulation.html",
        scenario=scenario,
        best=best,
        policies=list(summary["policy"]),
        runs=int(summary["runs"].min()),
        summary=summary_texts(summary),
        paired=paired_texts(folder.paired),
        notes=count_notes(summary.to_dict("records")),
        guide=guide,
        bound=folder.objects["success_bound"],
        pictures=pictures,
        command=f"casswarm {shlex.join(map(str, record['arguments']))}",
        record=record,
    )


def _picture(figure: Figure) -> dict[str, Any]:
    """A figure as a reproducible SVG with text as outlines, since fonts differ; size in pixels."""
    width, height = (round(96 * inches) for inches in figure.get_size_inches())
    with rc_context({"svg.hashsalt": "casswarm", "svg.fonttype": "path"}):
        address = figure_uri(figure, "svg", dpi=110, metadata={"Date": None})
    return {"address": address, "width": width, "height": height}
