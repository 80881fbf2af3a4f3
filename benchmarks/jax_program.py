"""The batch solver's competitor: the same spectral projected gradient in JAX, jit and vmap.

What an expert would write in JAX for the formation problems with the paper's rates: closed-form
projections as arrays of candidates, derivatives by `jax.value_and_grad`, a nonmonotone search as in
SPG2 (Birgin, Martinez and Raydan, SIAM J. Optim. 10(4), 2000) in `lax.while_loop`, one program a
shape. Needs ``pip install jax``, which only this benchmark does.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

jax.config.update("jax_enable_x64", True)

MEMORY, SUFFICIENT, ROUNDING, BACKTRACKS = 10, 1e-4, 2.0**-46, 10
Array = Any


def objective(v: Array, state: dict[str, Array], radars: Array, numbers: dict[str, float]) -> Array:
    """Weighted sum of the paper's rates (equations 8 and 9) after the step."""
    x = state["positions"] + state["dt"] * v.reshape(-1, 2)
    alive, weights = state["alive"], state["weights"]
    core = 1e-4
    source = numbers["alpha_1"] / jnp.maximum(
        jnp.sum((x[:, None] - radars[None]) ** 2, axis=-1), core
    )
    pairs = jnp.sum((x[:, None] - x[None]) ** 2, axis=-1)
    density = (1.0 / (1.0 + numbers["alpha_3"] * pairs)) @ alive
    rate = jnp.sum(source, axis=1) / (1.0 + numbers["alpha_2"] * density)
    if "beta_1" in numbers:
        near = jnp.maximum(pairs, core)
        power = jnp.exp(0.5 * numbers["beta_2"] * jnp.log(numbers["beta_1"] ** 2 / near))
        rate = rate + (power * (1.0 - jnp.eye(len(x)))) @ alive
    return weights @ rate


def project(points: Array, sets: Array, discs: int) -> Array:
    """Nearest points (n, 2) of boxes and discs, rows of ten numbers as casswarm packs them."""
    lower, upper = sets[:, 0:2], sets[:, 2:4]
    c1, r1 = sets[:, 4:6], sets[:, 6:7]
    candidates = [points, c1 + (points - c1) * r1 / length(points - c1)]
    candidates += lines(lower, upper, c1, r1)
    if discs == 2:
        c2, r2 = sets[:, 7:9], sets[:, 9:10]
        candidates += [c2 + (points - c2) * r2 / length(points - c2)]
        candidates += lines(lower, upper, c2, r2) + circles(c1, r1, c2, r2)
    stack = jnp.stack(candidates)
    clipped = jnp.clip(stack, lower, upper)
    away = jnp.where(jnp.isfinite(clipped).all(-1), jnp.sum((clipped - points) ** 2, -1), jnp.inf)
    for k in range(discs):
        c, r = sets[:, 4 + 3 * k : 6 + 3 * k], sets[:, 6 + 3 * k]
        slack = ROUNDING * (jnp.abs(clipped).max(-1) + jnp.abs(c).max(-1) + r)
        away = jnp.where(length(clipped - c)[..., 0] <= r + slack, away, jnp.inf)
    best = jnp.argmin(away, axis=0)
    return jnp.take_along_axis(clipped, best[None, :, None], axis=0)[0]


def length(vector: Array) -> Array:
    """Euclidean length, the last axis kept."""
    return jnp.sqrt(jnp.sum(vector**2, axis=-1, keepdims=True))


def lines(lower: Array, upper: Array, center: Array, radius: Array) -> list[Array]:
    """Points where a circle crosses the four lines of a box; NaN where it does not."""
    found = []
    for bound in (lower, upper):
        half = jnp.sqrt(radius**2 - (bound - center) ** 2)
        for sign in (-1.0, 1.0):
            other = center[:, ::-1] + sign * half
            found += [
                jnp.stack([bound[:, 0], other[:, 0]], -1),
                jnp.stack([other[:, 1], bound[:, 1]], -1),
            ]
    return found


def circles(c1: Array, r1: Array, c2: Array, r2: Array) -> list[Array]:
    """Points where two circles cross; NaN where they do not."""
    between = c2 - c1
    distance = length(between)
    along = (distance**2 + r1**2 - r2**2) / (2 * distance)
    across = jnp.sqrt(r1**2 - along**2)
    unit = between / distance
    normal = jnp.stack([-unit[:, 1], unit[:, 0]], -1)
    return [c1 + along * unit + sign * across * normal for sign in (-1.0, 1.0)]


def minimise(
    start: Array,
    state: dict[str, Array],
    sets: Array,
    units: Array,
    radars: Array,
    numbers: dict[str, float],
    discs: int,
    tolerance: float,
    iterations: int,
) -> tuple[Array, Array, Array]:
    """SPG2 of one state from one start: x, f, residual."""
    value = partial(objective, state=state, radars=radars, numbers=numbers)
    slope_of = jax.value_and_grad(value)
    metric = units[0] ** 2 / units[1]

    def projected(x: Array) -> Array:
        return project(x.reshape(-1, 2), sets, discs).ravel()

    def residual(x: Array, g: Array) -> Array:
        return jnp.abs(projected(x - metric * g) - x).max() / units[0]

    x = projected(start)
    f, g = slope_of(x)
    first = residual(x, g)
    carry = (x, f, g, metric / jnp.maximum(first, 1e-300), jnp.full(MEMORY, f), first, 0)

    def unfinished(carry: tuple[Array, ...]) -> Array:
        return (carry[5] > tolerance) & (carry[6] < iterations)

    def body(carry: tuple[Array, ...]) -> tuple[Array, ...]:
        x, f, g, step, history, _, k = carry
        d = projected(x - jnp.clip(step, 1e-10 * metric, 1e10 * metric) * g) - x
        slope, reference = d @ g, history.max()

        def refused(search: tuple[Array, ...]) -> Array:
            enough = reference + SUFFICIENT * search[0] * slope + 1e-15 * jnp.abs(f)
            return (search[1] > enough) & (search[2] < BACKTRACKS)

        def shorter(search: tuple[Array, ...]) -> tuple[Array, ...]:
            t, ft, count = search
            q = -0.5 * t * t * slope / (ft - f - t * slope)
            t = jnp.where((q >= 0.1 * t) & (q <= 0.9 * t), q, 0.5 * t)
            return t, value(x + t * d), count + 1

        t, _, _ = lax.while_loop(refused, shorter, (1.0, value(x + d), 0))
        s = t * d
        f, then = slope_of(x + s)
        curved = s @ (then - g)
        step = jnp.where(curved > 0, (s @ s) / curved, 1e10 * metric)
        history = history.at[k % MEMORY].set(f)
        return x + s, f, then, step, history, residual(x + s, then), k + 1

    x, f, _, _, _, r, _ = lax.while_loop(unfinished, body, carry)
    return x, f, r


def batch_program(
    radars: Array, numbers: dict[str, float], discs: int, tolerance: float, iterations: int
) -> Callable[..., tuple[Array, Array, Array]]:
    """Compiled program: starts (S, B, nx), states, sets (B, n, 10), units (B, 2) to x, f, r."""
    one = partial(
        minimise,
        radars=jnp.asarray(radars),
        numbers=numbers,
        discs=discs,
        tolerance=tolerance,
        iterations=iterations,
    )

    def best(starts: Array, state: Array, sets: Array, units: Array) -> tuple[Array, ...]:
        x, f, r = jax.vmap(lambda start: one(start, state, sets, units))(starts)
        at = jnp.argmin(jnp.where(jnp.isfinite(f), f, jnp.inf))
        return x[at], f[at], r[at]

    return jax.jit(jax.vmap(best, in_axes=(1, 0, 0, 0)))
