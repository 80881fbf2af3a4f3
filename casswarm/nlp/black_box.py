"""Programs whose functions and derivatives are computed by code outside CasADi."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from .._util.threads import one_at_a_time
from ..typing import FloatArray
from .program import LagrangianHessian, Nlp


class BlackBox(ABC):
    """An objective and constraints with exact first and second derivatives, all dense. It pickles.

    Parameters
    ----------
    n : int
        Number of variables.
    m : int
        Number of constraints.
    """

    n: int
    m: int

    @abstractmethod
    def values(self, x: FloatArray) -> FloatArray:
        """Values of f and g at x, (1 + m,)."""

    @abstractmethod
    def jacobian(self, x: FloatArray) -> FloatArray:
        """Derivatives of f and g at x, (1 + m, n)."""

    @abstractmethod
    def hessian(self, x: FloatArray, weights: FloatArray) -> FloatArray:
        """Second derivatives at x of f and g, weighted by (1 + m,) and summed: (n, n)."""


@dataclass(frozen=True, eq=False)
class BlackBoxNlp(Nlp):
    """The program of a black box, which is evaluated by callbacks.

    Parameters
    ----------
    box : BlackBox
    callbacks : tuple of casadi.Callback
        Those of its expressions, which CasADi does not keep.
    """

    box: BlackBox | None = None
    callbacks: tuple[Any, ...] = ()

    @classmethod
    @one_at_a_time
    def of(cls, name: str, box: BlackBox) -> BlackBoxNlp:
        """The program of a black box: a block x of variables and a block g of constraints."""
        x = ca.MX.sym("x", box.n)
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", box.m)
        callbacks = _Values(box), _Hessian(box)
        values = callbacks[0](x)
        upper = ca.triu(callbacks[1](x, ca.vertcat(lam_f, lam_g)))
        return cls(
            name,
            {"x": x},
            {},
            values[0],
            {"g": values[1:]} if box.m else {},
            attachments=(
                LagrangianHessian(ca.Function("hessian", [x, ca.MX(0, 1), lam_f, lam_g], [upper])),
            ),
            box=box,
            callbacks=callbacks,
        )

    def __reduce__(self) -> tuple[Any, ...]:
        # callbacks are not serialised
        others = (each for each in self.attachments if not isinstance(each, LagrangianHessian))
        return _restore, (self.name, self.box, *others)


def _restore(name: str, box: BlackBox, *attachments: object) -> BlackBoxNlp:
    return BlackBoxNlp.of(name, box).with_attachments(*attachments)


class _Callback(ca.Callback):
    """A function of dense arguments of given sizes, with a single output."""

    value: Callable[..., FloatArray]

    def __init__(self, box: BlackBox, inputs: Sequence[int], output: tuple[int, int]) -> None:
        ca.Callback.__init__(self)
        self.box, self._inputs, self._output = box, inputs, output
        self._kept: list[Any] = []  # CasADi does not keep the functions of derivatives
        self.construct(f"black_box{type(self).__name__.lower()}", {})

    def get_n_in(self) -> int:
        return len(self._inputs)

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, i: int) -> Any:
        return ca.Sparsity.dense(self._inputs[i], 1)

    def get_sparsity_out(self, _: int) -> Any:
        return ca.Sparsity.dense(*self._output)

    def eval(self, arguments: Sequence[Any]) -> list[FloatArray]:
        value = self.value(*(np.asarray(argument).ravel() for argument in arguments))
        return [np.asarray(value, dtype=float).reshape(self._output)]

    def keep(self, function: Any) -> Any:
        """The function, referred to from here."""
        self._kept.append(function)
        return function


class _Values(_Callback):
    """Of f and g; derivatives in reverse mode are those of weighted sums."""

    def __init__(self, box: BlackBox) -> None:
        super().__init__(box, [box.n], (1 + box.m, 1))

    def value(self, x: FloatArray) -> FloatArray:
        return self.box.values(x)

    def has_jacobian(self) -> bool:
        return True

    def get_jacobian(self, name: str, inames: Any, onames: Any, options: Any) -> Any:
        x, values = ca.MX.sym("x", self.box.n), ca.MX.sym("values", 1 + self.box.m)
        jacobian = self.keep(_Jacobian(self.box))(x)
        return self.keep(ca.Function(name, [x, values], [jacobian], inames, onames, options))

    def has_reverse(self, number: int) -> bool:
        return number == 1

    def get_reverse(self, _: int, name: str, inames: Any, onames: Any, options: Any) -> Any:
        x = ca.MX.sym("x", self.box.n)
        values, weights = (ca.MX.sym(name, 1 + self.box.m) for name in ("values", "weights"))
        gradient = self.keep(_Gradient(self.box))(x, weights)
        function = ca.Function(name, [x, values, weights], [gradient], inames, onames, options)
        return self.keep(function)

    def has_forward(self, number: int) -> bool:
        return number == 1

    def get_forward(self, _: int, name: str, inames: Any, onames: Any, options: Any) -> Any:
        x, step = (ca.MX.sym(name, self.box.n) for name in ("x", "step"))
        values = ca.MX.sym("values", 1 + self.box.m)
        change = self.keep(_Change(self.box))(x, step)
        function = ca.Function(name, [x, values, step], [change], inames, onames, options)
        return self.keep(function)


class _Change(_Callback):
    """Derivative of f and g along a step."""

    def __init__(self, box: BlackBox) -> None:
        super().__init__(box, [box.n, box.n], (1 + box.m, 1))

    def value(self, x: FloatArray, step: FloatArray) -> FloatArray:
        return self.box.jacobian(x) @ step

    def has_reverse(self, number: int) -> bool:
        return number == 1

    def get_reverse(self, _: int, name: str, inames: Any, onames: Any, options: Any) -> Any:
        x, step = (ca.MX.sym(name, self.box.n) for name in ("x", "step"))
        change, weights = (ca.MX.sym(name, 1 + self.box.m) for name in ("change", "weights"))
        outputs = [
            self.keep(_Hessian(self.box))(x, weights) @ step,
            self.keep(_Gradient(self.box))(x, weights),
        ]
        inputs = [x, step, change, weights]
        return self.keep(ca.Function(name, inputs, outputs, inames, onames, options))


class _Jacobian(_Callback):
    """Of f and g."""

    def __init__(self, box: BlackBox) -> None:
        super().__init__(box, [box.n], (1 + box.m, box.n))

    def value(self, x: FloatArray) -> FloatArray:
        return self.box.jacobian(x)


class _Gradient(_Callback):
    """Of a weighted sum of f and g."""

    def __init__(self, box: BlackBox) -> None:
        super().__init__(box, [box.n, 1 + box.m], (box.n, 1))

    def value(self, x: FloatArray, weights: FloatArray) -> FloatArray:
        return weights @ self.box.jacobian(x)

    def has_jacobian(self) -> bool:
        return True

    def get_jacobian(self, name: str, inames: Any, onames: Any, options: Any) -> Any:
        x, weights = ca.MX.sym("x", self.box.n), ca.MX.sym("weights", 1 + self.box.m)
        outputs = [
            self.keep(_Hessian(self.box))(x, weights),
            self.keep(_Jacobian(self.box))(x).T,
        ]
        inputs = [x, weights, ca.MX.sym("gradient", self.box.n)]
        return self.keep(ca.Function(name, inputs, outputs, inames, onames, options))


class _Hessian(_Callback):
    """Of a weighted sum of f and g."""

    def __init__(self, box: BlackBox) -> None:
        super().__init__(box, [box.n, 1 + box.m], (box.n, box.n))

    def value(self, x: FloatArray, weights: FloatArray) -> FloatArray:
        return self.box.hessian(x, weights)
