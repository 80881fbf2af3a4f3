"""A simulation as one self-contained HTML page: tables, figures, inputs, how to repeat it."""

from __future__ import annotations

import shlex
from dataclasses import dataclass

import pandas as pd
from matplotlib.figure import Figure

from .._util.documents import render
from ..figures import theme
from ..studies.tables import paired_texts, summary_texts
from ..typing import Progress
from . import catalogue
from .folder import ResultsFolder
from .pictures import svg_uri

CAPTIONS = {
    "success": "Success probability of every policy. Bars: fraction of runs in which at least one "
    "member reached the target alive; lines: 95 % intervals (Wilson).",
    "differences": "Differences in success between policies, paired run by run under common random "
    "numbers; lines: 95 % intervals (Newcombe). Where a line crosses zero, the runs do not show "
    "which policy is better.",
    "guide": "The guide, over the hazard rate of an isolated agent. If members keep within a "
    "corridor, it is around the guide's points.",
    "run": "Trajectory of one run, over the hazard rate of an isolated agent. Members often share "
    "a path: the first is drawn widest. Crosses: where members were destroyed, with their numbers.",
    "formation": "Close-up of the same run. Shades: the hazard rate of one more member, given the "
    "others, relative to an isolated agent: the lighter, the better they protect. Members at the "
    "same position share a label.",
}


@dataclass(frozen=True)
class Picture:
    """A figure as a data URI, its size in CSS pixels, and its caption."""

    name: str
    address: str
    width: int
    height: int
    caption: str


def simulation_page(folder: ResultsFolder, run: int = 0, progress: Progress | None = None) -> str:
    """HTML page of a folder that casswarm simulate wrote.

    Parameters
    ----------
    folder : ResultsFolder
    run : int
        Which of the saved runs is shown.
    progress : Progress, optional
        Receives the name of every figure.

    Raises
    ------
    CheckpointError
        The folder lacks a table, or was written by another command.
    """
    folder.trajectory(run=run)  # raises for other commands
    record, summary = folder.record, folder.table("summary")
    scenario, guide = folder.scenario, folder.guide
    figures = {**folder.figures(run), **catalogue.plan_figures(scenario, guide)}
    pictures = {}
    with theme("page"):
        for number, (name, draw) in enumerate(figures.items()):
            if progress is not None:
                progress(name, number, len(figures))
            pictures[name] = picture(name, draw())
    paired = folder.table("paired") if folder.has_table("paired") else pd.DataFrame()
    best = summary.sort_values("success", ascending=False).to_dict("records")[0]
    return render(
        "simulation.html",
        scenario=scenario,
        best=best,
        policies=list(summary["policy"]),
        runs=int(summary["runs"].min()),
        summary=summary_texts(summary),
        paired=paired_texts(paired),
        failures=int(summary["solver_failures"].sum()),
        infeasible=int(summary["infeasible"].sum()),
        guide=guide,
        bound=folder.objects["success_bound"],
        pictures=pictures,
        run=run,
        command=f"casswarm {shlex.join(map(str, record['arguments']))}",
        text=record["scenario"],
        record=record,
    )


def picture(name: str, figure: Figure) -> Picture:
    """A figure as it is embedded in the page."""
    width, height = (round(96 * inches) for inches in figure.get_size_inches())
    kind = name if name in CAPTIONS else name.split("-")[0]
    return Picture(name, svg_uri(figure), width, height, CAPTIONS[kind])
