"""Agreement of two comparisons: whether each ranks the solvers within the other's error bars."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import pandas as pd

from .._util.files import differences
from .._util.text import counted
from ..errors import ComparisonError
from .ranking import rankings_by_criterion

if TYPE_CHECKING:
    from .result import Comparison

_KEYS = ["family", "start", "criterion", "solver"]
_LEFT_OUT = ("problems.", "record_iterates")  # of the inputs that are compared


@dataclass(frozen=True, eq=False, repr=False)
class Agreement:
    """Whether two comparisons agree, by every criterion of a ranking.

    Ranks are those among the solvers of both. A row agrees if the rank in each comparison is among
    those that the other one gives the solver with 95 %, `rank_low` to `rank_high` of
    `casswarm.comparison.ranking.ranking`. These intervals are those of other problems of the same
    kind. Two runs on the same problems differ by the noise of their times alone, so they should
    agree; that they do says nothing about other problems.

    Parameters
    ----------
    table : DataFrame
        A row per family, start, criterion and solver of both. Columns: these; rank, rank_low,
        rank_high, mean_ms, and the same with the suffix _other; same_rank; agrees; mean_within,
        whether each mean time is in the other's 95 % interval.
    different : dict
        What of their inputs differs, as a pair of values by name, without the problems' hashes.
    skipped : int
        Number of rankings without error bars, which are left out: they are of few problems.
    same_problems : bool
        Whether both are of the same problems, by their fingerprints.
    """

    table: pd.DataFrame = field(repr=False)
    different: dict[str, tuple[object, object]]
    skipped: int
    same_problems: bool

    @property
    def agrees(self) -> bool:
        """Whether all rows do."""
        return bool(self.table["agrees"].all())

    @property
    def summary(self) -> pd.DataFrame:
        """Counts by family, start and criterion: solvers; same_rank, agrees and mean_within."""
        groups = self.table.groupby(_KEYS[:3], sort=False)
        counts = groups[["same_rank", "agrees", "mean_within"]].sum()
        return counts.assign(solvers=groups.size()).reset_index()

    @property
    def disagreements(self) -> pd.DataFrame:
        """The rows that do not agree."""
        return self.table[~self.table["agrees"]]

    def __repr__(self) -> str:
        return f"<Agreement: {str(self).splitlines()[0]}>"

    def __str__(self) -> str:
        table, bad = self.table, self.disagreements
        rankings = counted(len(self.summary), "ranking")
        lines = [
            f"{len(table) - len(bad)} of {counted(len(table), 'rank')} in {rankings} agree within "
            f"95 % intervals; {int(table['same_rank'].sum())} are the same; "
            f"{int(table['mean_within'].sum())} mean times are within both intervals"
        ]
        lines += [
            f"{row.family}, {row.start} start, {row.criterion}: {row.solver} has rank "
            f"{row.rank:g} ({row.rank_low:g} to {row.rank_high:g}), in the other "
            f"{row.rank_other:g} ({row.rank_low_other:g} to {row.rank_high_other:g})"
            for row in bad.itertuples()
        ]
        if self.skipped:
            lines.append(f"{counted(self.skipped, 'ranking')} of few problems without intervals")
        if not self.same_problems:
            lines.append("the problems are not the same")
        lines += [f"{key}: {a}, in the other {b}" for key, (a, b) in self.different.items()]
        return "\n".join(lines)


def agreement(first: Comparison, second: Comparison) -> Agreement:
    """See `Comparison.agreement`."""
    common = set.intersection(*(_ranked(one.runs) for one in (first, second)))
    if not common:
        raise ComparisonError("the comparisons have no solver on a family and start in common")
    tables = [_rankings(one, common) for one in (first, second)]
    both = tables[0].merge(tables[1], on=_KEYS, suffixes=("", "_other"))
    low, high = both["rank_low"].notna(), both["rank_low_other"].notna()
    known = both[low & high]
    known = known.assign(
        same_rank=known["rank"] == known["rank_other"],
        agrees=_within(known, "rank", "rank_low", "rank_high"),
        mean_within=_within(known, "mean_ms", "mean_ms_low", "mean_ms_high"),
    ).reset_index(drop=True)
    if known.empty:
        raise ComparisonError(
            "the comparisons have too few problems in a family for error bars, which ranks are "
            "compared by"
        )
    rankings, of_known = (len(table[_KEYS[:3]].drop_duplicates()) for table in (both, known))
    a, b = first.inputs, second.inputs
    return Agreement(known, _different(a, b), rankings - of_known, a["problems"] == b["problems"])


def _ranked(runs: pd.DataFrame) -> set[tuple[str, str, str]]:
    """Families, starts and solvers of a ranking."""
    applicable = runs.loc[runs["applicable"], ["family", "start", "solver"]]
    return set(applicable.itertuples(index=False, name=None))


def _rankings(comparison: Comparison, common: set[tuple[str, str, str]]) -> pd.DataFrame:
    """Ranks by all criteria among the solvers that both comparisons have."""
    runs = comparison.runs
    keys = runs[["family", "start", "solver"]].itertuples(index=False, name=None)
    shared = runs[[key in common for key in keys]]
    return rankings_by_criterion(shared, float(comparison.inputs["time_limit"]))


def _within(table: pd.DataFrame, value: str, low: str, high: str) -> pd.Series:
    """Whether the value of each comparison is in the interval of the other."""
    there = table[f"{value}_other"].between(table[low], table[high])
    return there & table[value].between(table[f"{low}_other"], table[f"{high}_other"])


def _different(
    first: dict[str, object], second: dict[str, object]
) -> dict[str, tuple[object, object]]:
    """Inputs that differ, other than the problems and what depends on them."""
    different = differences(first, second)
    return {key: pair for key, pair in different.items() if not key.startswith(_LEFT_OUT)}
