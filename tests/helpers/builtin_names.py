"""Names of the built-in scenarios."""

BUILTIN = [
    "alley",
    "barricade",
    "blink",
    "crossfire",
    "gauntlet",
    "large-swarm",
    "paper-1",
    "paper-2",
    "patrol",
    "ring",
    "single-agent",
    "wall",
]
