"""Ranks of solvers with error bars, what would change them, and whether two comparisons agree.

The score of a solver is its shifted geometric mean solve time, in which failures count as the time
limit. The problems are resampled, with all copies of a problem together (see
`casswarm.comparison.profiles`), and the probability of a rank is the fraction of resamples in
which the solver has it. It says how stable the order of the solvers is for problems of this kind;
it knows nothing of other problems, machines or options. Below 30 problems, and with more where
solvers fail on some, it is larger than the probability that the rank is right
(``docs/solver-comparison.md``).

Problems are independent, and all of one kind, unless their family says more: see
`casswarm.comparison.families.Family`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from .._util.files import differences
from .._util.text import counted
from ..errors import ComparisonError
from ..typing import FloatArray
from .families import FAMILIES
from .profiles import LEVEL, cluster_means, rank_probabilities, ranks, resampled_means
from .verification import SHIFT, costs, groups, start_text

if TYPE_CHECKING:
    from .result import Comparison


def sampling_units(family: str, problems: Iterable[str]) -> list[str]:
    """Sampling unit of each problem: the problem itself, or its `Family.unit`."""
    record = FAMILIES.get(family)
    if record is None or record.unit is None:
        return list(problems)
    return list(map(record.unit, problems))


def strata(family: str, units: Sequence[str]) -> list[str]:
    """Kind of each unit, of which there are fixed numbers in a sample: see `Family.kind`.

    If there is a single one of some kind, all are taken as of one kind, which overestimates the
    variance.
    """
    record = FAMILIES.get(family)
    one_kind = [""] * len(units)
    if record is None or record.kind is None:
        return one_kind
    kinds = list(map(record.kind, units))
    return kinds if min(Counter(kinds).values()) > 1 else one_kind


FEWEST = 8
"""Number of independent problems below which there are no error bars.

With fewer, 95 % intervals of mean times cover less than 90 % in simulations of a solver that fails
on 30 % of the problems: often it solves all that are there.
"""

ENOUGH = 30
"""Number of independent problems below which probabilities of ranks are said to be overconfident.

Simulations are in ``benchmarks/rank_calibration.py``."""

PENALTY = 10.0
"""Factor of the time limit at which failures count in one of the variants."""


def ranking(table: pd.DataFrame, time_limit: float) -> pd.DataFrame:
    """Ranks by (family, start, solver), the best first.

    Parameters
    ----------
    table : DataFrame
        From `casswarm.comparison.verification.verify`.
    time_limit : float
        Seconds, at which failures count.

    Returns
    -------
    DataFrame
        Columns: family, start, solver; mean_ms, and mean_ms_low and mean_ms_high, its 95 %
        interval; rank; probability, of this rank; rank_low and rank_high, the ranks between which
        the solver is with 95 %; independent, the number of independent problems. Intervals and
        probabilities are NaN where there are fewer than `FEWEST` of these; below `ENOUGH`, the
        probabilities are overconfident: see `rank_note`.
    """
    return _by_criterion(table, time_limit, 1).drop(columns="criterion")


def rank_note(ranked: pd.DataFrame) -> str:
    """What to know of the probabilities in ranks of one family and start; empty if nothing."""
    few = np.min(ranked.get("independent", ENOUGH)) < ENOUGH
    if not few or ranked["probability"].isna().all():
        return ""
    return (
        f"fewer than {ENOUGH} problems: probabilities of ranks are overconfident (0.94 was right "
        "in 73 to 93 % of simulated comparisons)"
    )


def pooled_ranking(table: pd.DataFrame, time_limit: float) -> pd.DataFrame:
    """Ranks by (family, solver) over all kinds of starts together, the best first.

    A problem with all of its starts and copies is one of the problems that are resampled, so that
    error bars do not shrink with the number of starts. Solvers that do not apply from some start
    are left out.

    Parameters
    ----------
    table, time_limit
        As of `ranking`.

    Returns
    -------
    DataFrame
        Columns: family; starts, their number; and those of `ranking` from solver on.
    """
    starts = pd.DataFrame(groups(table), columns=["family", "start"])
    parts = []
    for family, part in starts.groupby("family", sort=False):
        times = [costs(table, str(family), start, "solve_seconds") for start in part["start"]]
        ranked = rank_solvers(pd.concat(times, join="inner"), time_limit, family=str(family))
        ranked.insert(0, "family", family)
        ranked.insert(1, "starts", len(part))
        parts.append(ranked)
    return pd.concat(parts, ignore_index=True)


def rank_solvers(
    seconds: pd.DataFrame, time_limit: float, failure: float | None = None, family: str = ""
) -> pd.DataFrame:
    """Ranks of solvers by their shifted geometric mean time.

    Parameters
    ----------
    seconds : DataFrame
        A row per run, infinite for failures, with the problem's name as index; a column per
        solver.
    time_limit : float
        Slower runs are failures.
    failure : float, optional
        Seconds at which failures count; by default the time limit.
    family : str
        Of the problems: see `casswarm.comparison.ranking`.

    Returns
    -------
    DataFrame
        The columns of `ranking` from solver on.
    """
    values = seconds.to_numpy(dtype=float)
    most = failure or time_limit
    limited = np.where(values <= time_limit, values, most)
    units = sampling_units(family, seconds.index)
    logs = cluster_means(np.log(limited + SHIFT), units)
    means = logs.mean(axis=0)
    rank = ranks(means[None])[0]
    low = high = probability = rank_low = rank_high = np.full(len(means), np.nan)
    if len(logs) >= FEWEST:
        resampled = resampled_means(logs, strata(family, list(dict.fromkeys(units))))
        resampled = np.clip(resampled, np.log(SHIFT), np.log(most + SHIFT))  # possible means
        low, high = np.quantile(resampled, [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=0)
        low, high = np.minimum(low, means), np.maximum(high, means)  # up to rounding
        held = rank_probabilities(resampled)
        probability = held[np.arange(len(rank)), np.floor(rank).astype(int) - 1]
        rank_low, rank_high = _quantiles(held)
    ranked = pd.DataFrame(
        {
            "solver": seconds.columns,
            "mean_ms": _milliseconds(means),
            "mean_ms_low": _milliseconds(low),
            "mean_ms_high": _milliseconds(high),
            "rank": rank,
            "probability": probability,
            "rank_low": rank_low,
            "rank_high": rank_high,
            "independent": len(logs),
        }
    )
    return ranked.sort_values("rank", kind="stable", ignore_index=True)


def rankings_by_criterion(table: pd.DataFrame, time_limit: float) -> pd.DataFrame:
    """The ranks of `ranking`, and those by the other criteria of `sensitivity`.

    Columns: family, start, criterion, and those of `ranking` from solver on.
    """
    return _by_criterion(table, time_limit)


def sensitivity(table: pd.DataFrame, time_limit: float) -> pd.DataFrame:
    """First solver by other criteria: what would change the ranking.

    Columns: family, start; criterion; first, the solver of rank 1 by it, and probability, of that
    rank; rank, by this criterion, of the solver that is the first by mean solve time.
    """
    ranked = _by_criterion(table, time_limit)
    first = ranked.drop_duplicates(_KEYS[:3], ignore_index=True)
    leader = first.groupby(_KEYS[:2], sort=False)["solver"].transform("first")
    rank = first[_KEYS[:3]].assign(solver=leader).merge(ranked)["rank"]
    shown = first.rename(columns={"solver": "first"})
    return shown[[*_KEYS[:3], "first", "probability"]].assign(rank=rank)


def _by_criterion(table: pd.DataFrame, time_limit: float, most: int | None = None) -> pd.DataFrame:
    """Ranks by the first `most` criteria, by default all."""
    parts = [
        ranked.assign(family=family, start=start, criterion=criterion)
        for family, start in groups(table)
        for criterion, ranked in islice(_variants(table, family, start, time_limit), most)
    ]
    ranked = pd.concat(parts, ignore_index=True)
    return ranked[[*_KEYS[:3], *ranked.columns.drop(_KEYS[:3])]]


_KEYS = ["family", "start", "criterion", "solver"]


def _variants(
    table: pd.DataFrame, family: str, start: str, time_limit: float
) -> Iterator[tuple[str, pd.DataFrame]]:
    """Criteria, and the ranks by them; the first is that of `ranking`."""
    rank = partial(rank_solvers, family=family)
    seconds = costs(table, family, start, "solve_seconds")
    yield "mean solve time", rank(seconds, time_limit)
    total = table.assign(total=table["build_seconds"] + table["solve_seconds"])
    yield "with building", rank(costs(total, family, start, "total"), time_limit)
    yield "a quarter of the time limit", rank(seconds, time_limit / 4)
    penalised = rank(seconds, time_limit, PENALTY * time_limit)
    yield f"failures count as {PENALTY:g} time limits", penalised
    for success, criterion in (
        ("best_known", "best known objective required"),
        ("low_accuracy", "solved to low accuracy"),
        ("high_accuracy", "solved to high accuracy"),
    ):
        times = costs(table, family, start, "solve_seconds", success)  # type: ignore[arg-type]
        yield criterion, rank(times, time_limit)
    if table["copy"].any():
        originals = costs(table[table["copy"] == 0], family, start, "solve_seconds")
        yield "without copies", rank(originals, time_limit)


def _milliseconds(log_seconds: FloatArray) -> FloatArray:
    return np.asarray(1e3 * (np.exp(log_seconds) - SHIFT))


def _quantiles(held: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ranks between which every solver is with 95 %, from its probabilities of all ranks."""
    cumulative = held.cumsum(axis=1)
    low = (cumulative < (1 - LEVEL) / 2).sum(axis=1)
    high = (cumulative < (1 + LEVEL) / 2 - 1e-12).sum(axis=1)
    return 1.0 + low, 1.0 + high


# --- agreement of two comparisons

_LEFT_OUT = ("problems.", "record_iterates")  # of the inputs that are compared


@dataclass(frozen=True, eq=False, repr=False)
class Agreement:
    """Agreement of two comparisons, by every criterion of a ranking.

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
        """True if all rows agree."""
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
            f"{row.family}, {start_text(str(row.start))}, {row.criterion}: {row.solver} has rank "
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
    """Agreement of two comparisons on the solvers that both have."""
    keys = ["family", "start", "solver"]
    ranked = [
        one.runs.loc[one.runs["applicable"], keys].drop_duplicates() for one in (first, second)
    ]
    common = ranked[0].merge(ranked[1])
    if common.empty:
        raise ComparisonError("the comparisons have no solver on a family and start in common")
    tables = [
        rankings_by_criterion(one.runs.merge(common), float(one.inputs["time_limit"]))
        for one in (first, second)
    ]
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
    different = {
        key: pair for key, pair in differences(a, b).items() if not key.startswith(_LEFT_OUT)
    }
    return Agreement(known, different, rankings - of_known, a["problems"] == b["problems"])


def _within(table: pd.DataFrame, value: str, low: str, high: str) -> pd.Series:
    """Mask of the rows in which each comparison's value is in the interval of the other."""
    there = table[f"{value}_other"].between(table[low], table[high])
    return there & table[value].between(table[f"{low}_other"], table[f"{high}_other"])
