"""A simulation or a sweep as one self-contained HTML page."""

from __future__ import annotations

import json
import shlex
from typing import TYPE_CHECKING, Any

from matplotlib import rc_context
from matplotlib.figure import Figure

from .._util.documents import figure_uri, json_text, render
from ..figures import theme
from ..studies.tables import count_notes, paired_texts, summary_texts
from . import catalogue

if TYPE_CHECKING:
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


_NUMBERS = ("success_low", "success_high", "survivors_mean", "guide_survival")


def sweep_page(folder: ResultsFolder) -> str:
    """HTML page of a folder that casswarm sweep wrote.

    Raises
    ------
    CheckpointError
        The folder lacks its table.
    """
    record, table = folder.record, folder.table("sweep")
    rows = table.to_dict("records")
    settings = {
        key: list(dict.fromkeys(str(row[key]) for row in rows)) for key in folder.objects["keys"]
    }
    points = [
        {
            "at": [values.index(str(row[key])) for key, values in settings.items()],
            "policy": row["policy"],
            "failure": "" if row["status"] == "ok" else str(row["reason"]),
            **{name: row[name] for name in _NUMBERS},
        }
        for row in rows
    ]
    data = {
        "keys": [{"key": key, "values": values} for key, values in settings.items()],
        "policies": list(dict.fromkeys(table["policy"])),
        "points": points,
    }
    return render(
        "sweep.html",
        scenario=folder.scenario,
        method="95 % intervals" if table["method"].eq("sampled").all() else "proven bounds",
        points=len(points),
        data=json.loads(json_text(data)),
        command=f"casswarm {shlex.join(map(str, record['arguments']))}",
        version=record["versions"]["casswarm"],
    )


PAGES = {"simulate": simulation_page, "sweep": sweep_page}
"""Pages by the command that writes them."""
