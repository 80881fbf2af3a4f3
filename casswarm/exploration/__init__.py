"""Exploring a scenario by hand: a session, the process that answers, a widget and a local page."""
