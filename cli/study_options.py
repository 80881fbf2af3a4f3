"""Options of the commands that evaluate policies: accuracy, workers, checkpoints."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Literal

import click

from .number import Number
from .options import option, refuse


@dataclass(frozen=True)
class ExactOptions:
    """How far outcome distributions are enumerated."""

    tolerance: float = option(
        "--tolerance",
        type=Number(0, 1, max_open=True),
        default=1e-3,
        help="Width of the probability bounds.",
    )
    max_states: int | None = option(
        "--max-states",
        type=click.IntRange(1),
        help="Maximum number of states to enumerate; bounds may be wider than the tolerance. "
        "[default: 1000000, or 10000 with more than 12 members]",
    )
    aggregation_tol: float | None = option(
        "--aggregation-tol",
        type=Number(0),
        help="Round the members' motion to a lattice of at most this spacing, so that nearly equal "
        "states coincide; 0 rounds nothing. The bounds are those of the policy with rounded "
        "commands. [default: 1.2e-7 v_max dt, the accuracy of solvers]",
    )


@dataclass(frozen=True)
class StudyOptions:
    """Workers and checkpoints of a study."""

    workers: int = option(
        "--workers",
        type=click.IntRange(1),
        default=1,
        help="Number of worker processes (does not affect results).",
    )
    dask: str | None = option(
        "--dask",
        metavar="ADDRESS",
        help="Run on the Dask cluster at this address, such as tcp://127.0.0.1:8786. "
        "Needs the extra: pip install 'casswarm[dask]'.",
    )
    resume: bool = option(
        "--resume",
        is_flag=True,
        help="Resume an interrupted study with the same inputs from its folder.",
    )
    overwrite: bool = option(
        "--overwrite", is_flag=True, help="Discard an unfinished study and start over."
    )

    def __post_init__(self) -> None:
        if self.resume and self.overwrite:
            raise click.UsageError("--resume and --overwrite: give one of them")
        if self.dask is not None:
            refuse("the workers are those of the cluster, --dask", "workers")

    @property
    def saved_since(self) -> float:
        """Time from which saved work is of this study: always if it is resumed, else now."""
        return 0.0 if self.resume else time.time()

    @property
    def if_exists(self) -> Literal["error", "resume", "overwrite"]:
        """What happens to an unfinished study in the folder."""
        return "resume" if self.resume else "overwrite" if self.overwrite else "error"
