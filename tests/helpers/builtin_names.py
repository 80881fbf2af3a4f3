"""Names of the built-in scenarios."""

from casswarm import builtin_scenarios

BUILTIN = list(builtin_scenarios())
