"""A policy for tests in other processes: no solver, and as slow as is asked for."""

from __future__ import annotations

import os
import time
from typing import Any

import numpy as np


def toward(step: int, positions: Any, previous_velocities: Any, alive: Any) -> Any:  # noqa: ARG001
    """Everybody to (2, 0.5) at most at 2 a component."""
    time.sleep(float(os.environ.get("SLOW", "0")))
    return np.clip(np.array([2.0, 0.5]) - positions, -2.0, 2.0)


def fatal_once(step: int, positions: Any, previous_velocities: Any, alive: Any) -> Any:
    """As `toward`, but the first process that asks dies of it."""
    if step == 0:
        try:
            with open(os.environ["FATAL"], "x"):  # noqa: PTH123
                pass
        except FileExistsError:
            pass
        else:
            os._exit(9)
    return toward(step, positions, previous_velocities, alive)


def fatal(step: int, positions: Any, previous_velocities: Any, alive: Any) -> Any:  # noqa: ARG001
    """Whoever asks dies of it, unless that is the process of the test."""
    os._exit(9)
