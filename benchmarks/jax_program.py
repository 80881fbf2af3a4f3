"""The spectral projected gradient of the batch solver in JAX, compiled by one jit, as a baseline.

A program that an expert might write in JAX for the formation problems with the paper's rates. All
states are lanes of arrays whose last axis is the batch, so that XLA's loops are vectorised.
Projections and the objective's gradient are closed forms. The line search is no inner loop but part
of each lane's state, so that an iteration is one gradient of every lane; when most lanes have
finished, the remaining ones are gathered and continue by themselves. If a single member has a
weight, it is the first, and no other rate is computed.

The method is SPG2 (Birgin, Martinez and Raydan, SIAM J. Optim. 10(4), 2000) with the line search of
Zhang and Hager (SIAM J. Optim. 14(4), 2004), from casswarm's initial guesses: coarsely from each,
then from the best until a step promises a relative decrease below a tolerance. Needs ``pip install
jax``, which is required by this benchmark only.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

jax.config.update("jax_enable_x64", True)

DECAY, SUFFICIENT, COARSE = 0.85, 1e-4, 1e-3
SHORTEST = 1e-12  # part of a step
NARROWEST, PART = 16, 4  # lanes at least, and how much narrower arrays become
ROUNDING = 2.0**-46
Array = Any
Lanes = dict[str, Array]
Slopes = Callable[..., tuple[Array, Array]]


def rates(v: Array, data: Lanes, radars: Array, numbers: dict[str, float], of: int) -> Array:
    """Weighted rates (equations 8 and 9) of the first `of` members after the step, and gradient.

    v (n, 2, B); f (B,). The derivative is written out: XLA's reverse mode takes four times as long.
    """
    x = data["positions"] + data["dt"] * v
    alive, weights = data["alive"], data["weights"][:of]
    core, a2, a3 = 1e-4, numbers["alpha_2"], numbers["alpha_3"]
    to_radar = x[:of, None] - radars[None, :, :, None]
    square = jnp.sum(to_radar**2, axis=2)
    source = numbers["alpha_1"] / jnp.maximum(square, core)
    source_slope = jnp.where(square > core, -source / jnp.maximum(square, core), 0.0)
    apart = x[:of, None] - x[None]
    pairs = jnp.sum(apart**2, axis=2)
    kernel = 1.0 / (1.0 + a3 * pairs)
    shield = 1.0 / (1.0 + a2 * jnp.sum(alive[None] * kernel, axis=1))
    lone = jnp.sum(source, axis=1)
    rate = lone * shield
    pull = (a2 * a3) * (lone * shield**2)[:, None] * kernel**2
    if "beta_1" in numbers:
        near = jnp.maximum(pairs, core)
        others = 1.0 - jnp.eye(x.shape[0])[:of, :, None]
        power = others * jnp.exp(-0.5 * numbers["beta_2"] * jnp.log(near / numbers["beta_1"] ** 2))
        rate = rate + jnp.sum(alive[None] * power, axis=1)
        pull = pull - jnp.where(pairs > core, 0.5 * numbers["beta_2"] * power / near, 0.0)
    force = 2.0 * (weights[:, None] * alive[None] * pull)[:, :, None] * apart
    own = jnp.sum(2.0 * source_slope[:, :, None] * to_radar, axis=1) * shield[:, None]
    gradient = -jnp.sum(force, axis=0)
    gradient = gradient.at[:of].add(jnp.sum(force, axis=1) + weights[:, None] * own)
    return jnp.sum(weights * rate, axis=0), data["dt"] * gradient


def project(points: Array, sets: Array, discs: int) -> Array:
    """Nearest points (n, 2, B) of boxes and discs, `sets` (n, 10, B) as casswarm packs them."""
    lower, upper = sets[:, 0:2], sets[:, 2:4]
    best, least = points, jnp.full(points[:, 0].shape, jnp.inf)
    c1, r1 = sets[:, 4:6], sets[:, 6:7]
    candidates = [points, toward(c1, r1, points), *crossings(lower, upper, c1, r1)]
    if discs == 2:
        c2, r2 = sets[:, 7:9], sets[:, 9:10]
        candidates += [toward(c2, r2, points), *crossings(lower, upper, c2, r2)]
        candidates += lens(c1, r1, c2, r2)
    for candidate in candidates:
        z = jnp.clip(candidate, lower, upper)
        away = jnp.sum((z - points) ** 2, axis=1)
        for k in range(discs):
            c, r = sets[:, 4 + 3 * k : 6 + 3 * k], sets[:, 6 + 3 * k]
            inside = jnp.sum((z - c) ** 2, axis=1) <= r**2 * (1.0 + ROUNDING) + ROUNDING
            away = jnp.where(inside, away, jnp.inf)
        nearer = away < least
        best = jnp.where(nearer[:, None], z, best)
        least = jnp.where(nearer, away, least)
    return jnp.where(jnp.isfinite(least)[:, None], best, jnp.clip(points, lower, upper))


def toward(center: Array, radius: Array, points: Array) -> Array:
    """Nearest points of circles."""
    out = points - center
    return center + out * (radius * lax.rsqrt(jnp.sum(out**2, axis=1, keepdims=True)))


def crossings(lower: Array, upper: Array, center: Array, radius: Array) -> list[Array]:
    """Points where a circle crosses the four lines of a box; NaN where it does not."""
    found = []
    for bound in (lower, upper):
        half = jnp.sqrt(radius**2 - (bound - center) ** 2)
        for sign in (-1.0, 1.0):
            other = center[:, ::-1] + sign * half
            found.append(jnp.stack([bound[:, 0], other[:, 0]], axis=1))
            found.append(jnp.stack([other[:, 1], bound[:, 1]], axis=1))
    return found


def lens(c1: Array, r1: Array, c2: Array, r2: Array) -> list[Array]:
    """Points where two circles cross; NaN where they do not."""
    between = c2 - c1
    square = jnp.sum(between**2, axis=1, keepdims=True)
    along = 0.5 * (1.0 + (r1**2 - r2**2) / square)
    across = jnp.sqrt(r1**2 / square - along**2)
    normal = jnp.stack([-between[:, 1], between[:, 0]], axis=1)
    return [c1 + along * between + sign * across * normal for sign in (-1.0, 1.0)]


def begin(x: Array, data: Lanes, slopes: Slopes, discs: int) -> Lanes:
    """The lanes at points of their sets, with directions of a first step."""
    f, g = slopes(x, data)
    first = 1.0 / jnp.maximum(jnp.max(jnp.abs(g), axis=(0, 1)), 1e-300)
    d = project(x - first * g, data["sets"], discs) - x
    one = jnp.ones_like(f)
    return {"x": x, "f": f, "g": g, "d": d, "slope": dot(g, d), "t": one, "mean": f, "count": one}


def tick(lanes: Lanes, data: Lanes, slopes: Slopes, discs: int) -> Lanes:
    """One trial point of every lane: it is taken, or the step is shortened."""
    x, f, t, slope = (lanes[key] for key in ("x", "f", "t", "slope"))
    trial = x + t * lanes["d"]
    ft, gt = slopes(trial, data)
    taken = ~lanes["done"] & (ft <= lanes["mean"] + SUFFICIENT * t * slope)
    s, y = trial - x, gt - lanes["g"]
    curved, square = dot(s, y), dot(s, s)
    step = jnp.where(curved > 0.0, square / jnp.where(curved > 0.0, curved, 1.0), jnp.inf)
    step = jnp.clip(step, 1e-10 * data["metric"], 1e10 * data["metric"])
    d = project(trial - step * gt, data["sets"], discs) - trial
    count = 1.0 + DECAY * lanes["count"]
    after = {"x": trial, "f": ft, "g": gt, "d": d, "slope": dot(gt, d), "count": count}
    after["mean"] = lanes["mean"] + (ft - lanes["mean"]) / count
    after = {key: jnp.where(taken, array, lanes[key]) for key, array in after.items()}
    shorter = jnp.clip(-0.5 * t * t * slope / (ft - f - t * slope), 0.1 * t, 0.5 * t)
    return after | {"t": jnp.where(taken, 1.0, shorter)}


def dot(first: Array, second: Array) -> Array:
    """Scalar products (B,)."""
    return jnp.sum(first * second, axis=(0, 1))


def spg(
    x: Array, data: Lanes, slopes: Slopes, discs: int, tolerance: float, ticks: int
) -> tuple[Array, Array, Array]:
    """The method in every lane from x (n, 2, B): x, f, and which lanes are not finished."""

    def ended(lanes: Lanes) -> Lanes:
        small = -lanes["slope"] <= tolerance * jnp.abs(lanes["f"])
        return lanes | {"done": small | (lanes["t"] < SHORTEST)}

    def run(lanes: Lanes, data: Lanes, few: int) -> Lanes:
        """Ticks until at most `few` lanes are unfinished."""

        def busy(carry: tuple[Lanes, Array]) -> Array:
            return (jnp.sum(~carry[0]["done"]) > few) & (carry[1] < ticks)

        def body(carry: tuple[Lanes, Array]) -> tuple[Lanes, Array]:
            return ended(tick(carry[0], data, slopes, discs)), carry[1] + 1

        return lax.while_loop(busy, body, (lanes, 0))[0]

    lanes = ended(begin(project(x, data["sets"], discs), data, slopes, discs))
    widths = [x.shape[-1]]
    while widths[-1] > NARROWEST:
        widths.append(-(-widths[-1] // PART))
    lanes = run(lanes, data, widths[1] if len(widths) > 1 else 0)
    for width, few in zip(widths[1:], [*widths[2:], 0], strict=True):
        left = jnp.argsort(lanes["done"])[:width]  # unfinished ones first
        part = run(*({k: v[..., left] for k, v in each.items()} for each in (lanes, data)), few)
        lanes = {key: lanes[key].at[..., left].set(part[key]) for key in lanes}
    return lanes["x"], lanes["f"], ~lanes["done"]


def batch_program(
    radars: Array, numbers: dict[str, float], of: int, discs: int, tolerance: float, ticks: int
) -> Callable[..., tuple[Array, Array, Array]]:
    """Compiled program: starts (S, n, 2, B) and the states' arrays to x, f, residual."""
    slopes = partial(rates, radars=jnp.asarray(radars), numbers=numbers, of=of)

    def solve(starts: Array, data: Lanes) -> tuple[Array, Array, Array]:
        number = starts.shape[0]
        if number == 1:
            return spg(starts[0], data, slopes, discs, tolerance, ticks)
        wide = {key: jnp.concatenate([array] * number, axis=-1) for key, array in data.items()}
        lanes = jnp.concatenate(list(starts), axis=-1)
        x, f, _ = spg(lanes, wide, slopes, discs, COARSE, ticks)
        best = jnp.argmin(jnp.where(jnp.isfinite(f), f, jnp.inf).reshape(number, -1), axis=0)
        chosen = jnp.stack(jnp.split(x, number, axis=-1))
        start = jnp.take_along_axis(chosen, best[None, None, None, :], axis=0)[0]
        return spg(start, data, slopes, discs, tolerance, ticks)

    return jax.jit(solve)
