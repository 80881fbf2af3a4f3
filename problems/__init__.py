"""The mathematics: one optimisation problem a file, symbolic, never solved here."""
