"""Model predictive control of a pole on a cart, by direct multiple shooting.

The equations are those of R. V. Florian, Correct equations for the dynamics of the cart-pole
system, 2007, without friction; masses and lengths are those of A. G. Barto, R. S. Sutton and
C. W. Anderson, IEEE Trans. Syst. Man Cybern. 13(5), 1983.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from casswarm.nlp.program import Instances, Nlp

CART, POLE, HALF, GRAVITY = 1.0, 0.1, 0.5, 9.81
FORCE, TRACK = 10.0, 2.4
"""Largest force, and distance of the cart from the middle of its track."""


def rate(state: ca.SX, force: ca.SX) -> ca.SX:
    """Derivative of (position, angle from upright, velocity, angular velocity)."""
    angle, velocity, spin = state[1], state[2], state[3]
    pushed = (force + POLE * HALF * spin**2 * ca.sin(angle)) / (CART + POLE)
    inertia = HALF * (4 / 3 - POLE * ca.cos(angle) ** 2 / (CART + POLE))
    turn = (GRAVITY * ca.sin(angle) - ca.cos(angle) * pushed) / inertia
    push = pushed - POLE * HALF * turn * ca.cos(angle) / (CART + POLE)
    return ca.vertcat(velocity, spin, push, turn)


def stepped(state: ca.SX, force: ca.SX, dt: float) -> ca.SX:
    """State after one step of the classical Runge-Kutta method."""
    one = rate(state, force)
    two = rate(state + dt / 2 * one, force)
    three = rate(state + dt / 2 * two, force)
    four = rate(state + dt * three, force)
    return state + dt / 6 * (one + 2 * two + 2 * three + four)


def cart_pole(steps: int, dt: float) -> Nlp:
    """A window: the parameter is the initial state, x are the states, then the forces."""
    states, forces, first = ca.SX.sym("s", 4, steps), ca.SX.sym("u", steps), ca.SX.sym("first", 4)
    weights, before, cost, defects = ca.DM([1.0, 10.0, 0.1, 0.1]), first, 0.0, []
    for k in range(steps):
        defects.append(states[:, k] - stepped(before, forces[k], dt))
        before = states[:, k]
        cost += ca.dot(weights, before**2) + 1e-2 * forces[k] ** 2
    cost += 10 * ca.dot(weights, before**2)
    variables = ca.vertcat(ca.vec(states), forces)
    name = f"cart-pole-{steps}-{dt:g}"
    return Nlp.from_expressions(name, variables, first, cost, ca.vertcat(*defects))


def cart_poles(
    count: int, steps: int = 20, dt: float = 0.08, seed: int = 0
) -> tuple[Nlp, Instances]:
    """Windows from random initial states, from hanging to upright; guesses stay where they are."""
    rng = np.random.default_rng(seed)
    first = rng.uniform(-1.0, 1.0, (count, 4)) * [1.0, np.pi, 1.0, 2.0]
    guess = np.hstack([np.tile(first, steps), np.zeros((count, steps))])
    limits = np.r_[np.tile([TRACK, np.inf, np.inf, np.inf], steps), np.full(steps, FORCE)][None]
    rows = np.zeros((1, 4 * steps))
    return cart_pole(steps, dt), Instances(guess, first, -limits, limits, rows, rows)
