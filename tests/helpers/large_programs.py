"""Programs of thousands of variables with sparse derivatives, and batches of their instances."""

from __future__ import annotations

import casadi as ca
import numpy as np

from casswarm.nlp import Instances, Nlp


def masses(count: int, steps: int, links: int = 5) -> tuple[Nlp, Instances]:
    """Predictive control of masses on a line with hardening springs: 3 variables a mass and step.

    Random initial states are the parameters; forces and displacements are limited.
    """
    x, p = ca.SX.sym("x", 3 * links, steps), ca.SX.sym("p", 2 * links)
    at, speed, rows, cost = p[:links], p[links:], [], ca.SX(0)
    for k in range(steps):
        now, after, force = x[:links, k], x[links : 2 * links, k], x[2 * links :, k]
        stretch = ca.diff(ca.vertcat(0, at, 0))
        pull = stretch + stretch**3
        rows += [now - at - 0.1 * after, after - speed - 0.1 * (ca.diff(pull) + force)]
        cost += ca.sumsqr(now) + 0.1 * ca.sumsqr(after) + 0.1 * ca.sumsqr(force)
        at, speed = now, after
    name, g = f"{links} masses, {steps} steps", ca.vertcat(*rows)
    nlp = Nlp.from_expressions(name, ca.vec(x), p, cost, g)
    limits = np.tile(np.repeat([2.0, 5.0, 0.5], links), steps)
    states = np.random.default_rng(0).uniform(-1.0, 1.0, (count, 2 * links))
    return nlp, _posed(nlp, states, limits)


def elliptic_control(count: int, side: int) -> tuple[Nlp, Instances]:
    """Control of -laplace(y) + y^3 = u on a square grid, with limits on u: 2 variables a node.

    The desired states are a product of sines with a random amplitude and a random offset.
    """
    y, u, p = ca.SX.sym("y", side, side), ca.SX.sym("u", side, side), ca.SX.sym("p", 2)
    padded = ca.SX(side + 2, side + 2)
    padded[1:-1, 1:-1] = y
    around = padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]
    h = 1.0 / (side + 1)
    rows = 4 * y - around + h**2 * (y**3 - u)
    nodes = h * np.arange(1, side + 1)
    goal = ca.SX(np.outer(np.sin(np.pi * nodes), np.sin(2 * np.pi * nodes)))
    cost = h**2 * (ca.sumsqr(y - p[0] * goal - p[1]) + 1e-3 * ca.sumsqr(u))
    x = ca.vertcat(ca.vec(y), ca.vec(u))
    nlp = Nlp.from_expressions(f"control on {side} x {side}", x, p, cost, ca.vec(rows))
    limits = np.repeat([np.inf, 20.0], side**2)
    return nlp, _posed(nlp, np.random.default_rng(0).uniform(-1.0, 1.0, (count, 2)), limits)


def _posed(nlp: Nlp, p: np.ndarray, limits: np.ndarray) -> Instances:
    size, _, rows = nlp.sizes
    zero = np.zeros(rows)
    return Instances(np.zeros((len(p), size)), p, -limits, limits, zero, zero)
