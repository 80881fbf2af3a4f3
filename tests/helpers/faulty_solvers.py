"""Faulty solvers, in a module so that another process can import them."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from casswarm.motion import PlanarSets
from casswarm.nlp import Instances, Nlp, Status
from casswarm.solvers import Answer, Ipopt, Solver

FAULTS = (
    "nan",
    "infeasible success",
    "non-stationary success",
    "wrong shape",
    "nothing",
    "raise",
    "build",
    "hang",
    "exit",
    "abort",
    "kill",
)


@dataclass(frozen=True)
class Faulty(Solver):
    """Ipopt with a fault in instances whose first parameter is at least `above`.

    A fault of `FAULTS`, or "unsendable": an answer that does not pickle.
    """

    fault: str = "nan"
    above: float = -np.inf

    name: ClassVar[str] = "faulty"
    summary: ClassVar[str] = "Ipopt with a fault"

    def prepare(self, nlp: Nlp) -> None:  # noqa: ARG002
        if self.fault == "build":
            raise RuntimeError("cannot be built")

    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        wrong = instances.p[:, 0] >= self.above
        if wrong.any():
            self._misbehave()
        answers = Ipopt().timed_answers(nlp, instances)[1]
        return [
            self._changed(answer, instances[i : i + 1]) if wrong[i] else answer
            for i, answer in enumerate(answers)
        ]

    def _misbehave(self) -> None:
        match self.fault:
            case "raise":
                raise ZeroDivisionError("not today")
            case "hang":
                time.sleep(600)
            case "exit":
                os._exit(3)
            case "abort":
                print("something terrible", flush=True)
                os.abort()
            case "kill":
                os.kill(os.getpid(), signal.SIGKILL)

    def _changed(self, answer: Answer, instance: Instances) -> Answer:
        match self.fault:
            case "nan":
                return replace(answer, x=np.full_like(answer.x, np.nan), message="fine")
            case "infeasible success":
                return replace(answer, x=answer.x + 10.0, status=Status.SOLVED, message="fine")
            case "non-stationary success":
                start = instance.x0[0]
                if isinstance(instance.feasible_set, PlanarSets):
                    points = start.reshape(*instance.feasible_set.shape, 2)
                    start = instance.feasible_set.project(points).reshape(start.shape)
                return replace(answer, x=start, status=Status.SOLVED, message="fine")
            case "wrong shape":
                return replace(answer, x=answer.x[:-1])
            case "unsendable":
                return replace(answer, message=lambda: "fine")  # type: ignore[arg-type]
            case "nothing":
                return None  # type: ignore[return-value]
        return answer


@dataclass(frozen=True)
class SlowAtFirst(Solver):
    """Ipopt that needs seconds for its first solve in a process, as compilation would."""

    name: ClassVar[str] = "slow-at-first"
    summary: ClassVar[str] = "Ipopt with a slow first solve"

    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        if not _SOLVED:
            time.sleep(4.0)
            _SOLVED.append(True)
        return Ipopt().run(nlp, instances)


@dataclass(frozen=True)
class Counting(Solver):
    """Ipopt whose message is the number of solves before in this process, which can end.

    Parameters
    ----------
    deadly : str
        Name of the problem that ends its process.
    """

    deadly: str = "deadly"

    name: ClassVar[str] = "counting"
    summary: ClassVar[str] = "Ipopt that counts its solves"

    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        if nlp.name == self.deadly:
            os._exit(3)
        before = len(_SOLVED)
        _SOLVED.append(True)
        answers = Ipopt().run(nlp, instances)
        return [replace(answer, message=f"{before} before") for answer in answers]


_SOLVED: list[bool] = []  # in this process
