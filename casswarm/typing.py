"""Types of arrays and expressions, as signatures name them."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Booleans: TypeAlias = NDArray[np.bool_]
Counts: TypeAlias = NDArray[np.int64]

Expression: TypeAlias = Any
"""A CasADi SX, MX or DM; CasADi has no type stubs."""
