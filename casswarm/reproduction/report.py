"""The page that ties tables and figures together, in words made of their numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import pandas as pd

from .._util.documents import markdown_table
from ..planning.guide import rounded_up
from .paper import PAPER_RUNS
from .reproduce import TABLES, Reproduction


def page(found: Reproduction, ending: str = "png") -> str:
    """Markdown text that shows every table and figure with its caption.

    Figures are links to files NAME.ENDING in its folder.
    """
    blocks: list[str] = [
        "# The paper reproduced",
        (
            "Written by `casswarm reproduce`, which makes everything here again. What it means is "
            "told in `docs/paper.md`. The paper shows the places of radars, target and members as "
            "a picture only: those used here are a calibration, not the paper's figure."
        ),
        *_tables(found, ending),
        *_paper_figures(ending),
        *_convergence(found, ending),
        *_empty(found, ending),
        *_beyond(found, ending),
        "## Slips and silences",
        (f"{TABLES['readings']}. *Letter*: how to have what the paper writes instead."),
        markdown_table(found.tables["readings"]),
    ]
    return "\n\n".join(blocks) + "\n"


def _picture(ending: str, name: str, caption: str) -> str:
    """A figure in a file beside the page, with how to read it."""
    return f"![{name}]({name}.{ending})\n\n*{caption}*"


def _tables(found: Reproduction, ending: str) -> list[str]:
    inside = found.tables["table-2"]["inside"]
    return [
        "## Table I",
        (f"{TABLES['table-1']} (`table-1.csv`)."),
        markdown_table(_shown(found.tables["table-1"], {"paper": "{:g}", "used": "{:g}"})),
        (f"{TABLES['geometry']} (`geometry.csv`)."),
        markdown_table(_shown(found.tables["geometry"], {"x": "{:g}", "y": "{:g}"})),
        "## Table II",
        (
            f"{TABLES['table-2']} (`table-2.csv`). Intervals are Wilson's, of 95 %; exact brackets "
            f"are proven. {int(inside.sum())} of the {len(inside)} brackets lie in the paper's "
            "interval."
        ),
        markdown_table(table_2_words(found.tables["table-2"], found.runs)),
        _picture(
            ending,
            "table-2",
            f"Table II: the paper's numbers with the interval that {PAPER_RUNS} runs leave, as "
            "many runs of casswarm, more of them, and the exact values.",
        ),
        (
            f"{TABLES['sensitivity']} (`sensitivity.csv`): the exact values, brackets at most 0.01 "
            "wide, and the risk and arrival step of the guide."
        ),
        _picture(
            ending,
            "sensitivity",
            "How the exact values move with the geometry; dotted: as calibrated. Leader and "
            "corridor hardly move, the naive policy does: when each of its members passes the gate "
            "is nearly indifferent to that member, but not to the others.",
        ),
    ]


def _paper_figures(ending: str) -> list[str]:
    told = {
        "figure-1": "Figure 1: leader protection. The leader follows the guide through the gate "
        "between the radars, the others close up to it.",
        "figure-2": "Figure 2: constrained trajectory. All keep to the corridor around the guide.",
        "figure-3": "Figure 3: leader protection with collisions. Members keep their distance, and "
        "rearrange when one is lost.",
        "figure-4": "Figure 4: the guides that the members follow under the naive policy, each the "
        "least risky path that a local search finds from the straight line.",
    }
    return [
        "## Figures 1 to 4",
        (
            "The runs shown are the first that succeed and lose two members, as the paper tells of "
            "its own; where none does among 200, the first that succeeds."
        ),
        *(_picture(ending, name, caption) for name, caption in told.items()),
    ]


def _convergence(found: Reproduction, ending: str) -> list[str]:
    last = found.tables["formation-convergence"].groupby("problems", sort=False).tail(1)
    columns = {
        "gap_median": "{:.2g}",
        "gap_largest": "{:.2g}",
        "residual_median": "{:.1g}",
        "residual_largest": "{:.1g}",
    }
    guide = found.tables["guide-convergence"].iloc[-1]
    return [
        "## Convergence of the projected gradient",
        (
            f"{TABLES['guide-convergence']} (`guide-convergence.csv`): after "
            f"{guide['iteration']:.0f} iterations at the paper's learning rate the path survives "
            f"with {guide['survival']:.2g}; Ipopt's from the same straight line, within a_max, "
            f"with {found.guide.survival:.2g}. The objective exp(-risk) is flat where the risk is "
            "large."
        ),
        (
            f"{TABLES['formation-convergence']} (`formation-convergence.csv`), at the learning "
            "rate of Table I, after its last iteration, over the steps of the run in which nobody "
            "is lost. *Gap*: of the objective, relative to the default solver's."
        ),
        markdown_table(_shown(last, columns)),
        _picture(
            ending,
            "convergence",
            "The projected gradient with the paper's learning rates and numbers of iterations, on "
            "the guide (above) and on the formation problems (below, medians over the steps).",
        ),
    ]


def _empty(found: Reproduction, ending: str) -> list[str]:
    return [
        "## Empty constraint sets",
        (
            f"{TABLES['infeasible']} (`infeasible.csv`): a member at the edge of the corridor with "
            "the wrong velocity cannot stay in it, and a leader that was elsewhere cannot be on "
            "the guide at once. casswarm then moves it as near as v_max and a_max allow."
        ),
        _picture(
            ending,
            "infeasible",
            "Members alive (line), and how many of them have an empty constraint set (bars), in "
            "500 runs of scenario I.",
        ),
        (
            f"{TABLES['empty-sets']} (`empty-sets.csv`): success where a_max and rho are larger, "
            "along the same guide. Brackets are proven; shortfalls are means of a run."
        ),
        markdown_table(_bracketed(found.tables["empty-sets"])),
    ]


def _beyond(found: Reproduction, ending: str) -> list[str]:
    table = found.tables["beyond"]
    sides = "sides: on which side of the guide each radar lies, left or right"
    return [
        "## Beyond the paper",
        (
            f"{TABLES['beyond']} (`beyond.csv`). The guide's survival is that of a lone member; "
            f"{sides}. Where the law needs too many states its head is proven and the rest "
            "sampled: a 95 % interval."
        ),
        markdown_table(_bracketed(_shown(table, {"guide_survival": "{:.4f}"}))),
        _picture(
            ending,
            "beyond",
            "Success of the three policies with other guides, in other scenarios, and with "
            "collisions; bars where the value is not known to the width of a symbol.",
        ),
    ]


def table_2_words(table: pd.DataFrame, runs: int) -> pd.DataFrame:
    """Table II for reading: numbers with their intervals as texts."""
    columns: dict[str, Callable[[pd.Series], str]] = {
        "policy": lambda row: str(row["policy"]),
        f"paper, {PAPER_RUNS} runs": lambda row: _with_interval(row, "paper"),
        "exact": lambda row: bracket_text(row["exact_low"], row["exact_high"]),
        f"casswarm, {PAPER_RUNS} runs": lambda row: _with_interval(row, f"runs_{PAPER_RUNS}"),
        f"casswarm, {runs} runs": lambda row: _with_interval(row, f"runs_{runs}", 4),
    }
    return pd.DataFrame(
        [{name: text(row) for name, text in columns.items()} for _, row in table.iterrows()]
    )


def _with_interval(row: pd.Series, name: str, digits: int = 2) -> str:
    low, high = row[f"{name}_low"], row[f"{name}_high"]
    ends = max(3, digits)
    return f"{row[name]:.{digits}f} ({low:.{ends}f} to {high:.{ends}f})"


def bracket_text(low: float, high: float) -> str:
    """A bracket as it is told: rounded outward, for it must hold what it held."""
    slack = 1e-9  # ends that are numbers of four digits stay what they are
    return f"{math.floor(1e4 * low + slack) / 1e4:.4f} to {rounded_up(high - slack):.4f}"


def _bracketed(table: pd.DataFrame) -> pd.DataFrame:
    """The table with its success bracket as one column of text."""
    ends = zip(table["success_low"], table["success_high"], strict=True)
    success = [bracket_text(low, high) for low, high in ends]
    place = list(table.columns).index("success_low")
    shown = table.drop(columns=["success_low", "success_high"])
    shown.insert(place, "success", success)
    return shown


def _shown(table: pd.DataFrame, formats: Mapping[str, str]) -> pd.DataFrame:
    """The table with columns written in the given formats."""
    texts = {name: [text.format(value) for value in table[name]] for name, text in formats.items()}
    return table.assign(**texts)


def words(found: Reproduction, name: str) -> Sequence[tuple[str, ...]]:
    """A table for a terminal: rows of texts, the first of them the columns' names."""
    table = found.tables[name]
    if name == "table-1":
        table = _shown(table, {"paper": "{:g}", "used": "{:g}"})
    elif name == "table-2":
        table = table_2_words(table, found.runs)
    elif "success_low" in table:
        table = _bracketed(table)
    return [tuple(map(str, table.columns)), *[tuple(map(str, row)) for row in table.to_numpy()]]
