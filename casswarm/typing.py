"""Types of arrays and expressions, as signatures name them."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
BoolArray: TypeAlias = NDArray[np.bool_]
IntArray: TypeAlias = NDArray[np.int64]

Expr: TypeAlias = Any
"""A CasADi SX, MX or DM; CasADi has no type stubs."""
