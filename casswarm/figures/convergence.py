"""Convergence of the paper's projected gradient."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from .policy_styles import policy_styles
from .style import GREY, INK, add_title, current_theme, despine, panels, scaled, themed

_DASHES = ("-", "--", "-.", ":")


@themed
def convergence_chart(
    guide: pd.DataFrame,
    formations: pd.DataFrame,
    references: Mapping[str, float],
) -> Figure:
    """Gaps and stationarity residuals of the projected gradient, for the guide and formations.

    Parameters
    ----------
    guide : DataFrame
        With the columns iteration, survival and residual.
    formations : DataFrame
        With the columns problems (a policy, a comma and a scenario), iteration, gap_median and
        residual_median.
    references : mapping
        Name to the survival of other guides.
    """
    narrow = current_theme().narrow
    across = 1 if narrow else 2
    fig, axes = panels(4, across, 2.3 if narrow else 0.75, sharex=True)
    survival, residual, gap, formation_residual = axes
    path: dict[str, Any] = {"color": INK, "marker": "o"}
    survival.plot(guide["iteration"], guide["survival"], **path)
    for number, (name, value) in enumerate(references.items()):
        survival.axhline(value, color=GREY, linewidth=scaled(), linestyle=_DASHES[1 + number % 3])
        survival.annotate(
            f"{name}: {value:.2g}",
            (1, value),
            (0, scaled(3)),
            textcoords="offset points",
            fontsize="small",
        )
    survival.set(title="guide: single-agent survival", yscale="log", ylim=(5e-5, 5))
    residual.plot(guide["iteration"], guide["residual"], **path)
    residual.set(title="guide: stationarity residual", yscale="log", ylim=(1e-5, 1e-2))
    styles = policy_styles(str(kind).split(",")[0] for kind in formations["problems"])
    for number, (kind, rows) in enumerate(formations.groupby("problems", sort=False)):
        style: dict[str, Any] = {
            "color": styles[str(kind).split(",")[0]].color,
            "linestyle": _DASHES[number % len(_DASHES)],
            "label": str(kind),
        }
        gap.plot(rows["iteration"], rows["gap_median"].clip(lower=1e-9), **style)
        formation_residual.plot(
            rows["iteration"], rows["residual_median"].clip(lower=1e-9), **style
        )
    gap.set(title="formation: gap to the best known objective", yscale="log")
    formation_residual.set(title="formation: stationarity residual", yscale="log")
    for panel in axes:
        panel.set_xscale("symlog", linthresh=1)
        panel.set(xlim=(0, 1e4), xticks=[0, 1, 10, 100, 1000, 10000])
        despine(panel)
    for panel in axes[-across:]:
        panel.set_xlabel("iteration")
    handles, labels = gap.get_legend_handles_labels()
    columns = 2 if narrow else 4
    fig.legend(handles, labels, loc="outside lower center", ncols=columns, title="formation of")
    add_title(fig, "the paper's projected gradient; formations: medians over the steps")
    return fig
