"""Names of the built-in scenarios."""

BUILTIN = [
    "alley",
    "barricade",
    "crossfire",
    "gauntlet",
    "large-swarm",
    "paper-1",
    "paper-2",
    "ring",
    "single-agent",
    "wall",
]
