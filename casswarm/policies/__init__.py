"""Policies: state of the swarm to velocities."""

from .registry import *
