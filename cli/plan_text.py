"""What casswarm plan prints."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator

import casswarm as csw

from .._util.text import counted

_MAX_CLASSES = 6  # that are printed; candidates.csv has them all


def plan_text(scenario: csw.Scenario, guide: csw.Guide, baseline: csw.Guide | None) -> str:
    """The guide, its certificate and its solve, and a global search for comparison if any."""
    counts = Counter(str(candidate.solution.status) for candidate in guide.candidates)
    radars = len(scenario.hazard.radar_positions)
    lines = [
        f"{scenario.name}: {counted(scenario.n, 'member')}, {counted(radars, 'radar')}, "
        f"{counted(scenario.n_steps, 'step')} of {scenario.time.dt:g}",
        f"{guide}",
        f"risk {guide.risk:.4f}",
        *_certificate(scenario, guide),
        f"{guide.solution}",
        f"solves: {', '.join(f'{count} {status}' for status, count in counts.items())}",
        *_homotopy_classes(guide),
    ]
    if baseline is not None:
        risk = f"risk {baseline.risk:.4f}"
        lines.append(f"a global search without a_max and margin: {baseline}, {risk}")
    elif not guide.solution.status.success:
        lines.append("the solver did not converge: this is its best iterate, not a minimum")
    else:
        lines += _limits(scenario, guide)
    return "\n".join(lines)


def _limits(scenario: csw.Scenario, guide: csw.Guide) -> Iterator[str]:
    """What limited the search for the guide, and the options without these limits."""
    limits = {}
    if guide.search == "local":
        limits["a local search"] = "--search global"
    if scenario.guide.arrival == "horizon":
        limits["arrival at the last step"] = "--arrival any"
    if limits:
        options = " ".join(limits.values())
        yield f"limited to {' and '.join(limits)}: {options} may find a better path"


def _homotopy_classes(guide: csw.Guide) -> Iterator[str]:
    """The best path of every homotopy class, unless there is only one class."""
    paths = guide.best_per_homotopy_class()
    if len(paths) < 2 or not paths[0].homotopy:
        return
    signatures = [candidate.homotopy for candidate in guide.candidates]
    yield "best path of each homotopy class (L, R: each radar is on its left or right):"
    for path in paths[:_MAX_CLASSES]:
        yield (
            f"  {path.homotopy}  survival {math.exp(-path.risk):.4f}, risk {path.risk:.4f}, "
            f"step {len(path.velocities)} ({counted(signatures.count(path.homotopy), 'solve')})"
        )
    if len(paths) > _MAX_CLASSES:
        yield f"  and {len(paths) - _MAX_CLASSES} more in candidates.csv"


def _certificate(scenario: csw.Scenario, guide: csw.Guide) -> Iterator[str]:
    """The gap to the bound and what it consists of, or what a user's hazard lacks for a bound."""
    certificate, start = guide.certificate, scenario.guide_start
    if certificate is None or guide.gap is None:
        if scenario.hazard.single_agent_lower_bound(start, start) is None:
            yield (
                "not certified: the bound needs a lower bound of your rates over boxes, "
                "lower_bound (see the documentation on custom hazard rates)"
            )
        return
    gap = f"gap {100 * guide.gap:.2g} % of the risk"
    proof = certificate.accelerated or certificate
    remaining = "a better path not found" if guide.search == "global" else "the local search"
    without = (
        f"{100 * certificate.gap:.2g} % without acceleration limits, survival "
        f"{certificate.survival:.4f}"
    )
    if certificate.accelerated is not None:
        gap += f", of paths within a_max that end as deep in the target ({without})"
        if proof.gap < 0.5 * guide.gap:
            gap += f"; remaining gap: {remaining}"
    elif certificate.gap < 0.5 * guide.gap:
        gap += (
            f" ({without}); remaining gap: acceleration, margin and arrival constraints, "
            f"or {remaining}"
        )
    yield gap
    if proof.gap > 0.01:
        yield f"the bound is not within 1 %: {proof.reason}"
