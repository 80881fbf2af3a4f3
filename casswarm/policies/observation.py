"""Observation of a state by a learned policy: an array of fixed shape, for batches of states.

Each member has a row of d = 6 + 2 k + 5 (n - 1) numbers, with k radars at rest:

- ``alive``: 1;
- ``time_left``: (N - t) / N, the fraction of the steps that are left;
- ``position``: X_i - c over the length L, with c the centre of the target;
- ``velocity``: V_i(t-1) / v_max;
- ``radars``: for every radar l its position from the member, (x_l - X_i) / L. Where radars move or
  switch, three numbers at time t dt, with its strength relative to the largest one; then those of
  the next `preview` steps;
- ``others``: for every other member j, in the order of their indices, five numbers: 1,
  (X_j - X_i) / L, V_j(t-1) / v_max; zeros if it was destroyed;
- ``guide``, with a guide only: its reference of the next step, (X*(t+1) - X_i) / L. Then d has
  two numbers more.

The row of a destroyed member is zero. The length L is the largest distance of a member from c
at the start, or the target's radius if that is larger: observations do not depend on units, and
not on where the origin is.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._util.text import shown
from ..compiled.kernels import contiguous, kernel
from ..errors import PolicyError
from ..hazard import Hazard, HazardInTime, KernelHazard, radar_table
from ..motion.step import Motion
from ..typing import BoolArray, FloatArray, IntArray
from .base import require_guide_of

if TYPE_CHECKING:
    from ..guide.guide import Guide
    from ..scenario import Scenario

DTYPES = ("float32", "float64")
"""Types of the numbers of an observation."""

_OWN, _OTHER = 6, 5  # numbers for a member itself, and another member
_GUIDE = 2
_ROUNDING = 1e-6  # of bounds, relative: observations may be in single precision
_ZERO, _ONE = np.uint64(0), np.uint64(1)


class ObservedState(NamedTuple):
    """B states in the order of the arguments of policies; the destroyed have zeros."""

    steps: IntArray  # (B,), t
    positions: FloatArray  # (B, n, 2), X(t)
    previous_velocities: FloatArray  # (B, n, 2), V(t-1)
    alive: BoolArray  # (B, n)


@dataclass(frozen=True, eq=False)
class Observation:
    """The observation of a scenario's states.

    Parameters
    ----------
    n, n_steps : int
    center : (2,)
        Of the target.
    length, v_max : float
        Units of positions and velocities.
    radars : (N + 1, k, 3) or (1, k, 2)
        Position and relative strength at every step; positions alone of radars at rest.
    starts : (n, 2)
    reach : float
        Largest change of a coordinate by the end.
    dtype : str
        Of `DTYPES`.
    references : (N + 1, 2) or (0, 2)
        X*(t+1) for every t, or nothing if the guide is not observed.
    """

    n: int
    n_steps: int
    center: tuple[float, float]
    length: float
    v_max: float
    radars: FloatArray
    starts: FloatArray
    reach: float
    dtype: str
    references: FloatArray

    @classmethod
    def from_scenario(
        cls,
        scenario: Scenario,
        dtype: Any = "float32",
        *,
        guide: Guide | None = None,
        preview: int = 0,
    ) -> Observation:
        """Observation of the states of a scenario.

        Parameters
        ----------
        scenario : Scenario
        dtype : dtype
            float32 or float64.
        guide : Guide, optional
            Whose reference of the next step is observed, too.
        preview : int
            Number of next steps whose radars are observed, too, where radars move or switch.

        Raises
        ------
        PolicyError
            A dtype that is neither float32 nor float64, a guide of another target or step, or a
            preview that is no whole number from 0.
        """
        try:
            name = np.dtype(dtype).name
        except TypeError:
            name = ""
        if name not in DTYPES:
            raise PolicyError(
                f"dtype = {shown(dtype)}; allowed: {' or '.join(DTYPES)}", dtype=dtype
            )
        if not isinstance(preview, int | np.integer) or not 0 <= preview <= scenario.n_steps:
            raise PolicyError(
                f"preview = {shown(preview)}; allowed: whole numbers of steps from 0 to "
                f"{scenario.n_steps}",
                key="preview",
                value=preview,
            )
        distances = scenario.target.distances(scenario.positions)
        v_max = Motion.from_scenario(scenario).v_max
        references = []
        if guide is not None:
            require_guide_of(scenario, guide)
            references = [guide.reference(step + 1) for step in range(scenario.n_steps + 1)]
        return cls(
            n=scenario.n,
            n_steps=scenario.n_steps,
            center=scenario.target.center,
            length=float(max(distances.max(), scenario.target.radius)),
            v_max=v_max,
            radars=_observed_radars(scenario.believed.hazard, scenario.n_steps, int(preview)),
            starts=scenario.positions,
            reach=scenario.n_steps * scenario.time.dt * v_max,
            dtype=name,
            references=np.array(references, float).reshape(-1, 2),
        )

    @property
    def size(self) -> int:
        """Numbers d of a member's row."""
        guide = _GUIDE if len(self.references) else 0
        return _OWN + int(self.radars[0].size) + _OTHER * (self.n - 1) + guide

    @property
    def slices(self) -> dict[str, slice]:
        """Slices of the parts of a row, by name."""
        radars = _OWN + self.radars[0].size
        others = radars + _OTHER * (self.n - 1)
        parts = {
            "alive": slice(0, 1),
            "time_left": slice(1, 2),
            "position": slice(2, 4),
            "velocity": slice(4, 6),
            "radars": slice(6, radars),
            "others": slice(radars, others),
        }
        return parts | {"guide": slice(others, self.size)} if len(self.references) else parts

    def __call__(
        self,
        steps: int | IntArray,
        positions: FloatArray,
        previous_velocities: FloatArray,
        alive: BoolArray,
    ) -> NDArray[Any]:
        """Observations (B, n, d) of B states, a new array.

        Parameters
        ----------
        steps : int or (B,) int
            t, of all states or of each.
        positions, previous_velocities : (B, n, 2)
            X(t) and V(t-1).
        alive : (B, n) bool
        """
        observations = np.empty((*alive.shape, self.size), self.dtype)
        each = np.full(len(alive), steps) if np.ndim(steps) == 0 else np.asarray(steps)
        _write_observations(
            self._frame,
            contiguous(each),
            contiguous(positions),
            contiguous(previous_velocities),
            contiguous(alive),
            np.empty((self.n, 4)),
            observations.reshape(-1),
        )
        return observations

    def state(self, observations: ArrayLike) -> ObservedState:
        """Restore states from their observations: the inverse of a call, up to rounding.

        Positions and velocities have the precision of `dtype`. Those of destroyed members are
        not part of an observation: zeros are returned for them.

        Parameters
        ----------
        observations : (B, n, d)
            As returned by a call or by an environment, of all members.

        Returns
        -------
        ObservedState
            Steps, positions, previous velocities, and the living.

        Raises
        ------
        PolicyError
            Observations of another shape or that are not finite; or a state without a living
            member, whose observation does not contain the step.
        """
        given = np.asarray(observations, float)
        if given.ndim != 3 or given.shape[1:] != (self.n, self.size):
            raise PolicyError(
                f"observations have shape {given.shape}; expected (B, {self.n}, {self.size}): "
                "(states, members, numbers of a row); of one state, pass observations[None]",
                shape=given.shape,
                expected=(self.n, self.size),
            )
        if not np.isfinite(given).all():
            row = tuple(map(int, np.argwhere(~np.isfinite(given))[0]))
            raise PolicyError(
                f"observations are not finite at index {row} (state, member, number)", index=row
            )
        alive = given[..., 0] > 0.5
        if not alive.any(axis=1).all():
            state = int(np.flatnonzero(~alive.any(axis=1))[0])
            raise PolicyError(
                f"the observation of state {state} has no living member, so that it does not "
                "contain the step: leave out states in which all members are destroyed",
                state=state,
            )
        left = given[np.arange(len(given)), alive.argmax(axis=1), 1]
        living, parts = alive[..., None], self.slices
        return ObservedState(
            steps=np.rint(self.n_steps * (1.0 - left)).astype(np.int64),
            positions=living
            * (np.asarray(self.center) + self.length * given[..., parts["position"]]),
            previous_velocities=living * (self.v_max * given[..., parts["velocity"]]),
            alive=alive,
        )

    @cached_property
    def _frame(self) -> _Frame:
        """Radars and references relative to the target, in lengths, and units."""
        references = contiguous((self.references - self.center) / self.length)
        radars = self.radars.copy()
        radars[..., :2] = (radars[..., :2] - self.center) / self.length
        return _Frame(*self.center, self.length, self.v_max, self.n_steps, radars, references)

    def bounds(self) -> tuple[NDArray[Any], NDArray[Any]]:
        """Least and greatest observations (n, d) of all states that can be reached."""
        n, between = self.n, self.starts[None] - self.starts[:, None]
        unit, speed = np.full((n, 2), 0.5), np.zeros((n, 2))
        others = np.zeros((n, n - 1, _OTHER))
        others[..., 0] = 0.5
        others[..., 1:3] = between[~np.eye(n, dtype=bool)].reshape(n, n - 1, 2) / self.length
        lowest, highest = self.radars.min(axis=0), self.radars.max(axis=0)
        lowest[:, 2:], highest[:, 2:] = 0.0, 1.0  # of relative strengths
        radars = np.tile((lowest + highest) / 2, (n, 1, 1))
        radars[..., :2] = (radars[..., :2] - self.starts[:, None]) / self.length
        of_radars = (highest - lowest) / 2
        of_radars[:, :2] = self.reach / self.length + of_radars[:, :2] / self.length
        references = self.references if len(self.references) else np.zeros((1, 2))
        ends = np.stack([references.min(axis=0), references.max(axis=0)])
        guide = (ends.mean(axis=0) - self.starts) / self.length
        middle = np.hstack(
            [
                *(unit, (self.starts - self.center) / self.length, speed),
                *(radars.reshape(n, -1), others.reshape(n, -1), guide),
            ]
        )[:, : self.size]
        reach = self.reach / self.length
        other = [0.5, 2 * reach, 2 * reach, 1.0, 1.0]
        from_guide = reach + (ends[1] - ends[0]) / (2 * self.length)
        numbers = [0.5, 0.5, reach, reach, 1.0, 1.0, *of_radars.ravel(), *other * (n - 1)]
        spread = np.array([*numbers, *from_guide])[: self.size]
        spread = spread + _ROUNDING * (np.abs(middle) + spread)
        return (
            np.minimum(middle - spread, 0.0).astype(self.dtype),  # the destroyed have zeros
            np.maximum(middle + spread, 0.0).astype(self.dtype),
        )


def _observed_radars(hazard: Hazard, n_steps: int, preview: int) -> FloatArray:
    """Radars (N + 1, (1 + preview) k, 3) of all steps; (1, k, 2) if they do not move or switch."""
    if not (isinstance(hazard, HazardInTime) and isinstance(hazard.hazard, KernelHazard)):
        return hazard.at(0.0).radar_positions.reshape(1, -1, 2).astype(float)
    snapshots = [hazard.after(step) for step in range(n_steps + 1 + preview)]
    radars = radar_table(*snapshots)[..., 0]  # type: ignore[arg-type]
    radars[..., 2] /= radars[..., 2].max(initial=np.finfo(float).tiny)
    coming = [radars[first : first + n_steps + 1] for first in range(preview + 1)]
    return np.concatenate(coming, axis=1)


class _Frame(NamedTuple):
    """Centre, units and steps, and radars (T, k, w) and references from the centre, in lengths."""

    east: float
    north: float
    length: float
    speed: float
    n_steps: int
    radars: FloatArray
    references: FloatArray


@kernel
def _append(numbers: Any, at: Any, first: float, second: float) -> Any:
    """Write two numbers from an index on; return the index after them.

    The index is unsigned: Numba examines others for negative values, which takes a third of the
    time.
    """
    numbers[at] = first
    numbers[at + _ONE] = second
    return at + _ONE + _ONE


@kernel
def _append_zeros(numbers: Any, at: Any, count: int) -> Any:
    """Write zeros from an unsigned index on; return the index after them."""
    for _ in range(count):
        numbers[at] = 0.0
        at += _ONE
    return at


@kernel
def _write_observations(
    frame: _Frame,
    steps: IntArray,
    positions: FloatArray,
    velocities: FloatArray,
    alive: BoolArray,
    members: FloatArray,
    observations: Any,
) -> None:
    """Write observations (B n d,) of B states; `members` (n, 4) is overwritten."""
    batch, n = alive.shape
    by_step, references = frame.radars, frame.references
    numbers, moments = by_step.shape[2], by_step.shape[0] - 1
    last = references.shape[0] - 1  # -1 without a guide
    size = 6 + by_step[0].size + 5 * (n - 1) + (2 if last >= 0 else 0)
    of_length, of_speed = 1.0 / frame.length, 1.0 / frame.speed
    at = _ZERO
    for b in range(batch):
        left = (frame.n_steps - steps[b]) / frame.n_steps
        radars = by_step[min(max(steps[b], 0), moments)]
        for i in range(n):
            members[i, 0] = (positions[b, i, 0] - frame.east) * of_length
            members[i, 1] = (positions[b, i, 1] - frame.north) * of_length
            members[i, 2] = velocities[b, i, 0] * of_speed
            members[i, 3] = velocities[b, i, 1] * of_speed
        for i in range(n):
            if not alive[b, i]:
                at = _append_zeros(observations, at, size)
                continue
            east, north = members[i, 0], members[i, 1]
            at = _append(observations, at, 1.0, left)
            at = _append(observations, at, east, north)
            at = _append(observations, at, members[i, 2], members[i, 3])
            for r in range(radars.shape[0]):
                at = _append(observations, at, radars[r, 0] - east, radars[r, 1] - north)
                if numbers == 3:
                    observations[at] = radars[r, 2]
                    at += _ONE
            for j in range(n):
                if j == i:
                    continue
                if alive[b, j]:
                    observations[at] = 1.0
                    at += _ONE
                    at = _append(observations, at, members[j, 0] - east, members[j, 1] - north)
                    at = _append(observations, at, members[j, 2], members[j, 3])
                else:
                    at = _append_zeros(observations, at, 5)
            if last >= 0:
                t = min(max(steps[b], 0), last)
                at = _append(observations, at, references[t, 0] - east, references[t, 1] - north)
