"""Preconditioner of Newton steps on a face: the diagonal blocks of the Hessian, inverted.

In a large swarm the curvatures of members differ by orders of magnitude: on a circle of radius r
with multiplier m there is m / r more, and the objective's grows with a member's neighbours. With
the blocks of all members as a preconditioner, conjugate gradients need few iterations.
"""

from __future__ import annotations

import math

from ...._util.jit import kernel
from ....typing import FloatArray

LEAST = 0.05  # smallest curvature of the preconditioner, relative to the mean of all members


@kernel
def invert_blocks(blocks: FloatArray, face: FloatArray) -> None:
    """Replace blocks (3n,) of the Hessian by those of the preconditioner's inverse on the face.

    Curvatures count by their magnitude, so that the preconditioner is positive definite.
    """
    total, count = 0.0, 0
    for i in range(face.shape[0]):
        low, high, _, _ = curvatures(blocks, face, i)
        if face[i, 0] > 0.0:
            total += high if face[i, 0] == 1.0 else 0.5 * (low + high)
            count += 1
    least = LEAST * total / count if total > 0.0 else 1.0
    for i in range(face.shape[0]):
        low, high, tx, ty = curvatures(blocks, face, i)
        low = 1.0 / max(low, least) if face[i, 0] == 2.0 else 0.0
        high = 1.0 / max(high, least) if face[i, 0] > 0.0 else 0.0
        blocks[3 * i] = high * tx * tx + low * ty * ty
        blocks[3 * i + 1] = (high - low) * tx * ty
        blocks[3 * i + 2] = high * ty * ty + low * tx * tx


@kernel
def write_identity(face: FloatArray, inverse: FloatArray) -> None:
    """Write the blocks (3n,) of the projection on the face."""
    for i in range(face.shape[0]):
        tx, ty = face[i, 1], face[i, 2]  # both zero but on a single boundary
        free = 1.0 if face[i, 0] == 2.0 else 0.0
        inverse[3 * i], inverse[3 * i + 1], inverse[3 * i + 2] = (
            free + tx * tx,
            tx * ty,
            free + ty * ty,
        )


@kernel
def curvatures(blocks: FloatArray, face: FloatArray, i: int) -> tuple[float, float, float, float]:
    """Magnitudes of member i's curvatures across and along a unit vector, and that vector.

    On a boundary the vector is its tangent, elsewhere the principal direction of larger curvature.
    """
    a, b, c = blocks[3 * i], blocks[3 * i + 1], blocks[3 * i + 2]
    if face[i, 0] == 1.0:
        tx, ty = face[i, 1], face[i, 2]
        along = a * tx * tx + 2.0 * b * tx * ty + c * ty * ty + face[i, 3]
        return 0.0, abs(along), tx, ty
    mean, half = 0.5 * (a + c), 0.5 * (a - c)
    radius = math.sqrt(half * half + b * b)
    high = mean + radius if mean >= 0.0 else mean - radius
    low = mean - radius if mean >= 0.0 else mean + radius
    tx, ty = (b, high - a) if abs(high - a) > abs(high - c) else (high - c, b)
    length = math.sqrt(tx * tx + ty * ty)
    if length > 0.0:
        return abs(low), abs(high), tx / length, ty / length
    return abs(low), abs(high), 1.0, 0.0


@kernel
def precondition(vector: FloatArray, inverse: FloatArray, out: FloatArray) -> float:
    """Write the preconditioned vector; return its product with the vector."""
    total = 0.0
    for i in range(vector.size // 2):
        vx, vy = vector[2 * i], vector[2 * i + 1]
        px = inverse[3 * i] * vx + inverse[3 * i + 1] * vy
        py = inverse[3 * i + 1] * vx + inverse[3 * i + 2] * vy
        out[2 * i], out[2 * i + 1] = px, py
        total += vx * px + vy * py
    return total
