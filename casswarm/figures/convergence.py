"""How the paper's projected gradient converges."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from .style import (
    GREY,
    INK,
    add_title,
    current_theme,
    despine,
    panels,
    policy_styles,
    scaled,
    themed,
)

_DASHES = ("-", "--", "-.", ":")


@themed
def convergence_chart(
    guide: pd.DataFrame,
    formations: pd.DataFrame,
    references: Mapping[str, float],
) -> Figure:
    """The projected gradient on the guide and on formations: how far off, and how stationary.

    Parameters
    ----------
    guide : DataFrame
        With the columns iteration, survival and residual.
    formations : DataFrame
        With the columns problems (a policy, a comma and a scenario), iteration, gap_median and
        residual_median.
    references : mapping
        Name to the survival that other guides have.
    """
    narrow = current_theme().width < 5
    across = 1 if narrow else 2
    fig, some = panels(across, 4 // across, 2.3 if narrow else 0.75, sharex=True)
    survival, residual, gap, formation_residual = some
    path: dict[str, Any] = {"color": INK, "marker": "o"}
    survival.plot(guide["iteration"], guide["survival"], **path)
    for place, (name, value) in enumerate(references.items()):
        survival.axhline(value, color=GREY, linewidth=scaled(), linestyle=_DASHES[1 + place % 3])
        survival.annotate(
            f"{name}: {value:.2g}",
            (1, value),
            (0, scaled(3)),
            textcoords="offset points",
            fontsize="small",
        )
    survival.set(title="guide: survival of a lone member", yscale="log", ylim=(5e-5, 5))
    residual.plot(guide["iteration"], guide["residual"], **path)
    residual.set(title="guide: stationarity residual", yscale="log", ylim=(1e-5, 1e-2))
    looks = policy_styles(str(kind).split(",")[0] for kind in formations["problems"])
    for place, (kind, rows) in enumerate(formations.groupby("problems", sort=False)):
        color, dashes = looks[str(kind).split(",")[0]].color, _DASHES[place % len(_DASHES)]
        for axes, column in ((gap, "gap_median"), (formation_residual, "residual_median")):
            median = rows[column].clip(lower=1e-9)
            axes.plot(rows["iteration"], median, color=color, linestyle=dashes, label=str(kind))
    gap.set(title="formation: gap to the best known", yscale="log")
    formation_residual.set(title="formation: stationarity residual", yscale="log")
    for axes in some:
        axes.set_xscale("symlog", linthresh=1)
        axes.set_xlim(0, 1e4)
        axes.set_xticks([0, 1, 10, 100, 1000, 10000])
        despine(axes)
    for axes in some[-across:]:
        axes.set_xlabel("iteration")
    handles, labels = gap.get_legend_handles_labels()
    columns = 2 if narrow else 4
    fig.legend(handles, labels, loc="outside lower center", ncols=columns, title="formation of")
    add_title(fig, "the paper's projected gradient; formations: medians over the steps")
    return fig
