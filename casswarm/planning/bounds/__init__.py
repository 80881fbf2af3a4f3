"""Proven lower bounds on the risk of every guide, and the value function behind them.

The proofs are in ``docs/global-guide.md``.
"""

from .grid import Relaxation
from .risk_bound import Certificate, Level, certify

__all__ = ["Certificate", "Level", "Relaxation", "certify"]
