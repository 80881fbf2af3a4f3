"""Parametric nonlinear programs, and batches of their instances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Protocol, Self, TypeVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._util.text import counted
from .._util.threads import locked_property, one_at_a_time
from ..errors import SolverError
from ..typing import BoolArray, Expr, FloatArray

Kind = TypeVar("Kind")


@dataclass(frozen=True, eq=False)
class LagrangianHessian:
    """Second derivatives of a program, attached where there is a faster method than CasADi's.

    Parameters
    ----------
    function : casadi.Function
        (x, p, lam_f, lam_g) to the upper triangle of the Lagrangian's Hessian.
    """

    function: Expr

    def __call__(self, *arguments: Any) -> Expr:
        """Call the function."""
        return self.function(*arguments)


@dataclass(frozen=True, eq=False)
class Nlp:
    """A parametric nonlinear program in canonical form.

    minimise f(x; p)  subject to  lbx <= x <= ubx,  lbg <= g(x; p) <= ubg

    The bounds belong to `Instances`, so that one program, built and compiled once, serves every
    state. x, p and g are made of named blocks: MX of shape (r, c), which as arrays are (c, r), so
    that a block of c points in the plane is an MX (2, c) and an array (c, 2). A program pickles:
    its expressions are serialised as a CasADi Function.

    Parameters
    ----------
    name : str
        Name in messages and tables.
    variables, parameters, constraints : mapping of name to MX
        Blocks of x and p (symbols) and g (expressions), in order.
    objective : MX, scalar
    unroll : bool
        Whether to expand the expressions to scalar operations, which evaluate several times
        faster; for large expressions that takes too much memory.
    attachments : tuple of object
        What solvers of other kinds than general ones know about the program, such as compiled
        forms of its functions: at most one of each type, defined beside the solver that reads it.
        They pickle with the program.
    """

    name: str
    variables: Mapping[str, Expr]
    parameters: Mapping[str, Expr]
    objective: Expr
    constraints: Mapping[str, Expr]
    unroll: bool = False
    attachments: tuple[object, ...] = ()

    @classmethod
    @one_at_a_time
    def from_expressions(cls, name: str, x: Expr, p: Expr, f: Expr, g: Expr) -> Nlp:
        """Program of CasADi expressions: columns of symbols x, p, and f, g, all SX or all MX.

        Its blocks are called x, p and g. Expressions of SX are evaluated as scalar operations.

        Raises
        ------
        RuntimeError
            CasADi's: x or p are not symbols, or f or g depend on other symbols.
        """
        unroll = isinstance(f, ca.SX) or isinstance(g, ca.SX)
        function = ca.Function("program", [x, p], [ca.densify(f), ca.densify(ca.vec(g))])
        variables = ca.MX.sym("x", x.numel())
        parameters = ca.MX.sym("p", p.numel()) if p.numel() else ca.MX(0, 1)
        objective, rows = function.call([variables, parameters], not unroll, False)
        blocks = {"p": parameters} if p.numel() else {}
        constraints = {"g": rows} if rows.numel() else {}
        return cls(name, {"x": variables}, blocks, objective, constraints, unroll=unroll)

    def __repr__(self) -> str:
        return f"Nlp({self.name!r}, {_described(self.sizes)})"

    @locked_property
    def x(self) -> Expr:
        """All variables, a column."""
        return ca.veccat(*self.variables.values())

    @locked_property
    def p(self) -> Expr:
        """All parameters, a column."""
        return ca.veccat(*self.parameters.values())

    @locked_property
    def g(self) -> Expr:
        """All constraints, a column."""
        return ca.veccat(*self.constraints.values()) if self.constraints else ca.MX(0, 1)

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Numbers of variables, parameters and constraints."""
        return self.x.shape[0], self.p.shape[0], self.g.shape[0]

    @locked_property
    def evaluate(self) -> Expr:
        """CasADi Function (x, p) to (f, g)."""
        function = ca.Function("evaluate", [self.x, self.p], [self.objective, self.g])
        return function.expand() if self.unroll else function

    @locked_property
    def _expressions(self) -> tuple[Expr, Expr, Expr, Expr]:
        """x, p, f and g; scalar ones of an unrolled program, which are differentiated faster."""
        if not self.unroll:
            return self.x, self.p, self.objective, self.g
        x, p = ca.SX.sym("x", self.sizes[0]), ca.SX.sym("p", self.sizes[1])
        return x, p, *self.evaluate(x, p)

    @locked_property
    def gradient(self) -> Expr:
        """CasADi Function (x, p) to (f, gradient of f)."""
        x, p, f, _ = self._expressions
        return ca.Function("gradient", [x, p], [f, ca.densify(ca.gradient(f, x))])

    @locked_property
    def jacobian(self) -> Expr:
        """CasADi Function (x, p) to the Jacobian of g, sparse."""
        x, p, _, g = self._expressions
        return ca.Function("jacobian", [x, p], [ca.jacobian(g, x)])

    @locked_property
    def lagrangian_hessian(self) -> Expr:
        """CasADi Function (x, p, lam_f, lam_g) to the upper triangle of the Lagrangian's Hessian.

        That of `LagrangianHessian` where it is attached.
        """
        own = self.attached(LagrangianHessian)
        if own is not None:
            return own.function
        x, p, f, g = self._expressions
        symbols = type(x).sym
        lam_f, lam_g = symbols("lam_f"), symbols("lam_g", self.sizes[2])
        upper = ca.triu(ca.hessian(lam_f * f + ca.dot(lam_g, g), x)[0])
        return ca.Function("hessian", [x, p, lam_f, lam_g], [upper])

    @one_at_a_time
    def __reduce__(self) -> tuple[Any, ...]:
        # symbols do not pickle, but functions of them do; inlining restores the graph
        function = ca.Function(
            "blocks",
            [*self.variables.values(), *self.parameters.values()],
            [self.objective, *self.constraints.values()],
        )
        names = tuple(self.variables), tuple(self.parameters), tuple(self.constraints)
        return _restore, (self.name, function, names, self.unroll, self.attachments)

    def attached(self, kind: type[Kind]) -> Kind | None:
        """The attachment of a type; None if there is none."""
        return next((each for each in self.attachments if isinstance(each, kind)), None)

    def with_attachments(self, *attachments: object) -> Self:
        """The same program with further attachments, in place of those of the same types."""
        kinds = tuple(map(type, attachments))
        kept = (each for each in self.attachments if not isinstance(each, kinds))
        return replace(self, attachments=(*kept, *attachments))

    @locked_property
    def row_names(self) -> tuple[str, ...]:
        """Name of every row of g, such as ``acceleration[3]``."""
        return _entry_names(self.constraints)

    @locked_property
    def variable_names(self) -> tuple[str, ...]:
        """Name of every entry of x, such as ``positions[3]``."""
        return _entry_names(self.variables)

    def pack_variables(self, **blocks: ArrayLike) -> FloatArray:
        """Variables of B instances, (B, nx), from arrays (B, c, r) or (c, r) by block."""
        return _pack(self.variables, blocks)

    def pack_parameters(self, **blocks: ArrayLike) -> FloatArray:
        """Parameters of B instances, (B, np), from arrays by block."""
        return _pack(self.parameters, blocks)

    def pack_constraints(self, **blocks: ArrayLike) -> FloatArray:
        """Bounds on g of B instances, (B, ng), from arrays by block."""
        return _pack(self.constraints, blocks)

    def parameter_blocks(self, p: FloatArray) -> dict[str, FloatArray]:
        """Arrays (B, c, r) of all blocks of parameters (B, np)."""
        return _unpack(self.parameters, p)

    def variable(self, name: str, x: FloatArray) -> FloatArray:
        """Block of x with this name: (..., nx) to (..., c, r)."""
        return _unpack(self.variables, x)[name]


@dataclass(frozen=True)
class NamedRows:
    """Rows and variables as the user named and counted them, attached to a program.

    Parameters
    ----------
    rows : tuple of str
    sizes : tuple of int
        How many entries of g each row has.
    variables : tuple of str
        Names of the entries of x.
    """

    rows: tuple[str, ...]
    sizes: tuple[int, ...]
    variables: tuple[str, ...]

    @classmethod
    def of(cls, nlp: Nlp) -> NamedRows:
        """What is attached to a program, or the entries of its blocks."""
        names = nlp.row_names
        own = nlp.attached(cls)
        return own or cls(names, (1,) * len(names), nlp.variable_names)


def _entry_names(blocks: Mapping[str, Expr]) -> tuple[str, ...]:
    return tuple(f"{name}[{i}]" for name, block in blocks.items() for i in range(block.numel()))


def _described(sizes: tuple[int, int, int]) -> str:
    nouns = "variable", "parameter", "constraint"
    return ", ".join(map(counted, sizes, nouns))


@one_at_a_time
def _restore(
    name: str,
    function: Expr,
    names: tuple[tuple[str, ...], ...],
    unroll: bool,
    attachments: tuple[object, ...],
) -> Nlp:
    """Restore the program that `Nlp.__reduce__` decomposed."""
    symbols = function.mx_in()
    objective, *rows = function.call(symbols, True, False)
    variables = dict(zip(names[0], symbols, strict=False))
    parameters = dict(zip(names[1], symbols[len(variables) :], strict=True))
    constraints = dict(zip(names[2], rows, strict=True))
    return Nlp(name, variables, parameters, objective, constraints, unroll, attachments)


def _pack(blocks: Mapping[str, Expr], arrays: Mapping[str, ArrayLike]) -> FloatArray:
    if blocks.keys() != arrays.keys():
        message = f"blocks = {sorted(arrays)}; expected: {sorted(blocks)}"
        raise SolverError(message, key="blocks", value=sorted(arrays), expected=sorted(blocks))
    values = {name: np.asarray(array, dtype=float) for name, array in arrays.items()}
    batch = max((a.shape[0] for a in values.values() if a.ndim == 3), default=1)
    columns = []
    for name, symbol in blocks.items():
        shape = (batch, symbol.shape[1], symbol.shape[0])
        try:
            columns.append(np.broadcast_to(values[name], shape).reshape(batch, symbol.numel()))
        except ValueError:
            raise SolverError(
                f"block {name!r} has shape {values[name].shape}; expected {shape}",
                key=name,
                shape=values[name].shape,
                expected=shape,
            ) from None
    return np.concatenate(columns, axis=1) if columns else np.empty((batch, 0))


def _unpack(blocks: Mapping[str, Expr], x: FloatArray) -> dict[str, FloatArray]:
    """Arrays (..., c, r) of all blocks, from their entries (..., size)."""
    if not blocks:
        return {}
    ends = np.cumsum([block.numel() for block in blocks.values()])
    parts = zip(blocks.items(), np.split(x, ends[:-1], axis=-1), strict=True)
    return {name: part.reshape(*x.shape[:-1], *block.shape[::-1]) for (name, block), part in parts}


def _wrong_shape(name: str, shape: tuple[int, ...], expected: str) -> SolverError:
    return SolverError(
        f"{name} of the instances has shape {shape}; expected: {expected}",
        key=name,
        shape=shape,
        expected=expected,
    )


class FeasibleSet(Protocol):
    """The sets of B instances, in a form that special solvers know.

    Not all have a projection: that onto paths within limits is a program itself. A solver that
    projects therefore asks for the kind of set that it can project onto.
    """

    def contains(self, points: FloatArray, tolerance: float = 0.0) -> BoolArray:
        """Test if points are in their sets, up to a distance; in the shapes of the kind of set."""

    def __getitem__(self, rows: slice | NDArray[Any], /) -> FeasibleSet:
        """The sets of some of the instances."""


def _numbers(name: str, values: Any) -> FloatArray:
    """Array of real numbers; SolverError for anything else."""
    try:
        array = np.asarray(values)
        if array.dtype.kind not in "cSUmM":
            return np.asarray(array, dtype=float)
    except (TypeError, ValueError):  # of lists of different lengths, or of objects
        kind = f"a {type(values).__name__}"
    else:
        kind = f"an array of {array.dtype}"
    message = f"{name} of the instances is {kind}; allowed: arrays of real numbers"
    raise SolverError(message, key=name, value=kind)


_COLUMNS = {"x0": 0, "p": 1, "lbx": 0, "ubx": 0, "lbg": 2, "ubg": 2, "scale": 3}
_COLUMNS |= {"lam_x0": 0, "lam_g0": 2}
"""Arrays of instances: as many columns as variables, parameters or constraints (0 to 2), or two."""


@dataclass(frozen=True, eq=False)
class Instances:
    """B instances of an `Nlp` in CasADi's notation: initial guesses, parameters and bounds.

    Parameters
    ----------
    x0 : (B, nx)
        Initial guesses; solvers that start from elsewhere by definition say so.
    p : (B, np)
        Parameters.
    lbx, ubx : (B, nx)
        Bounds on x.
    lbg, ubg : (B, ng)
        Bounds on g.
    feasible_set : FeasibleSet, optional
        The set that lbx, ubx, lbg and ubg describe, where it has a structure that special solvers
        exploit, such as a product of simple sets in the plane, onto which one can project.
    scale : (B, 2)
        A typical length of x and a typical value of f: what tolerances are relative to. Ones by
        default.
    lam_x0 : (B, nx), optional
        Initial guesses of the multipliers of the bounds on x, positive at an upper bound, such as
        those of a `BatchSolution`; NaN where there are none. Solvers that do not start from
        multipliers ignore them.
    lam_g0 : (B, ng), optional
        Likewise of g; none without `lam_x0`.

    Raises
    ------
    SolverError
        Arrays that are not of real numbers, or do not have a row for each instance, or one for all
        of them; a `scale` that is not above zero; or one of `lam_x0` and `lam_g0` without the
        other.
    """

    x0: FloatArray
    p: FloatArray
    lbx: FloatArray
    ubx: FloatArray
    lbg: FloatArray
    ubg: FloatArray
    feasible_set: FeasibleSet | None = None
    scale: FloatArray = field(default_factory=lambda: np.ones((1, 2)))
    lam_x0: FloatArray | None = None
    lam_g0: FloatArray | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "x0", _numbers("x0", self.x0))
        batch = self.x0.shape[:1]
        if (self.lam_x0 is None) is not (self.lam_g0 is None):
            missing = "lam_x0" if self.lam_x0 is None else "lam_g0"
            message = f"{missing} of the instances is missing; give both lam_x0 and lam_g0, or none"
            raise SolverError(message, key=missing)
        for name in self._arrays:
            array = self.x0 if name == "x0" else _numbers(name, getattr(self, name))
            rows = array.shape[:-1]
            shared = name != "x0" and array.ndim in (1, 2) and rows in ((), (1,))
            if self.x0.ndim != 2 or not (shared or rows == batch):
                count = batch[0] if self.x0.ndim == 2 else "B"
                raise _wrong_shape(name, array.shape, f"({count}, ...), a row for each instance")
            if name != "x0":
                array = np.broadcast_to(array, (*batch, array.shape[-1]))
            object.__setattr__(self, name, array)
        wrong = np.argwhere(~((self.scale > 0.0) & np.isfinite(self.scale)))
        if len(wrong):
            (i, k), value = wrong[0], float(self.scale[tuple(wrong[0])])
            message = f"scale[{i}, {k}] of the instances is {value:g}; allowed: above 0, finite"
            raise SolverError(message, key="scale", value=value)

    def require_fit(self, nlp: Nlp) -> None:
        """Raise SolverError if an array does not have the shape that a program needs."""
        widths = *nlp.sizes, 2
        for name in self._arrays:
            shape, expected = getattr(self, name).shape, (len(self), widths[_COLUMNS[name]])
            if shape != expected:
                raise _wrong_shape(name, shape, f"{expected} for the program {nlp.name!r}")

    @property
    def _arrays(self) -> list[str]:
        """Names of the arrays that there are."""
        absent = {name for name in ("lam_x0", "lam_g0") if getattr(self, name) is None}
        return [name for name in _COLUMNS if name not in absent]

    def __reduce__(self) -> tuple[Any, ...]:
        # the constructor makes broadcast arrays read-only again
        return type(self), self._values()

    def __len__(self) -> int:
        return int(self.x0.shape[0])

    def __repr__(self) -> str:
        sizes = self.x0.shape[1], self.p.shape[1], self.lbg.shape[1]
        return f"Instances({len(self)} of {_described(sizes)})"

    def __getitem__(self, rows: slice | NDArray[Any]) -> Instances:
        """Subset of the instances, selected by a slice, a mask or indices."""
        parts: list[Any] = [None if part is None else part[rows] for part in self._values()]
        return Instances(*parts)

    def _values(self) -> tuple[Any, ...]:
        return tuple(getattr(self, part.name) for part in fields(self))

    def with_x0(
        self,
        x0: FloatArray,
        lam_x0: FloatArray | None = None,
        lam_g0: FloatArray | None = None,
    ) -> Instances:
        """The same instances with other initial guesses, of x and of the multipliers.

        Without the latter they have none: multipliers of another point do not belong to these.
        """
        return replace(self, x0=x0, lam_x0=lam_x0, lam_g0=lam_g0)
