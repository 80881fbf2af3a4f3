"""Problem 71 of Hock and Schittkowski with the interfaces of PyCUTEst and of S2MPJ."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.sparse import lil_matrix

BIG = 1e20  # CUTEst's infinity


def f(x: Any) -> float:
    return float(x[0] * x[3] * (x[0] + x[1] + x[2]) + x[2])


def gradient(x: Any) -> Any:
    total = x[0] + x[1] + x[2]
    ends = x[0] * x[3]
    return np.array([x[3] * (total + x[0]), ends, ends + 1.0, x[0] * total])


def hessian(x: Any) -> Any:
    first, last, both = 2.0 * x[3], x[3], 2.0 * x[0] + x[1] + x[2]
    return np.array(
        [
            [first, last, last, both],
            [last, 0.0, 0.0, x[0]],
            [last, 0.0, 0.0, x[0]],
            [both, x[0], x[0], 0.0],
        ]
    )


def rows(x: Any) -> Any:
    return np.array([np.prod(x), np.sum(np.square(x))])


def jacobian(x: Any) -> Any:
    return np.array([[np.prod(np.delete(x, i)) for i in range(4)], 2.0 * np.asarray(x)])


def row_hessians(x: Any) -> list[Any]:
    product = np.array(
        [[0.0 if i == j else np.prod(np.delete(x, [i, j])) for j in range(4)] for i in range(4)]
    )
    return [product, 2.0 * np.eye(4)]


class CUTEstProblem:
    """The attributes and functions of `pycutest.CUTEstProblem` that its documentation lists."""

    def __init__(self, name: str = "HS71", drop_fixed_variables: bool = True) -> None:
        self.name, self.n, self.m = name, 4, 2
        self.sifParams: dict[str, object] = {}
        self.sifOptions: list[str] = []
        self.drop_fixed_vars = drop_fixed_variables
        self.vartype = np.zeros(4, dtype=int)
        self.x0 = np.array([1.0, 5.0, 5.0, 1.0])
        self.bl, self.bu = np.ones(4), np.full(4, 5.0)
        self.cl, self.cu = np.array([25.0, 40.0]), np.array([BIG, 40.0])

    def obj(self, x: Any, gradient: bool = False) -> Any:
        return (f(x), globals()["gradient"](x)) if gradient else f(x)

    def cons(self, x: Any) -> Any:
        return rows(x)

    def lagjac(self, x: Any, v: Any = None) -> Any:
        assert v is None
        return gradient(x), jacobian(x)

    def hess(self, x: Any, v: Any = None) -> Any:
        assert v is not None, "v must be specified for constrained problems"
        assert v.shape == (2,)
        return hessian(x) + sum(w * h for w, h in zip(v, row_hessians(x), strict=True))

    def ihess(self, x: Any) -> Any:
        return hessian(x)


class Unconstrained(CUTEstProblem):
    """Without constraints: several attributes are None, and Hessians take no multipliers."""

    def __init__(self) -> None:
        super().__init__("FREE")
        self.m, self.cl, self.cu = 0, None, None

    def obj(self, x: Any, gradient: bool = False) -> Any:
        value = float(np.sum((x - 2.0) ** 4 + (x - 2.0) ** 2))
        return (value, 4.0 * (x - 2.0) ** 3 + 2.0 * (x - 2.0)) if gradient else value

    def cons(self, x: Any) -> Any:  # noqa: ARG002
        return None

    def hess(self, x: Any, v: Any = None) -> Any:
        assert v is None
        return np.diag(12.0 * (x - 2.0) ** 2 + 2.0)


def import_problem(name: str, **options: Any) -> CUTEstProblem:
    """What `pycutest.import_problem` does with a name that it has, and one that it has not."""
    if name != "HS71":
        raise RuntimeError(f"Unable to decode {name}.SIF")
    made = CUTEstProblem(name, options.get("drop_fixed_variables", True))
    made.sifParams = options["sifParams"] or {}
    return made


PYCUTEST = SimpleNamespace(import_problem=import_problem)


class HS71:
    """The attributes and functions of S2MPJ's problems: columns, and sparse matrices."""

    name = "HS71"

    def __init__(self) -> None:
        self.n, self.m = 4, 2
        self.objgrps, self.congrps = np.array([0]), np.array([2, 1])
        self.x0 = np.array([[1.0], [5.0], [5.0], [1.0]])
        self.xlower, self.xupper = np.ones((4, 1)), np.full((4, 1), 5.0)
        self.clower = np.array([[0.0], [0.0]])
        self.cupper = np.array([[0.0], [np.inf]])
        self.pbclass = "C-COOR2-AY-4-2"
        self.objderlvl, self.conderlvl = 2, [2]

    def fx(self, x: Any) -> float:
        return f(x.ravel())

    def fgx(self, x: Any) -> Any:
        return self.fx(x), gradient(x.ravel()).reshape(-1, 1)

    def fgHx(self, x: Any) -> Any:  # noqa: N802
        return *self.fgx(x), lil_matrix(hessian(x.ravel()))

    def cx(self, x: Any) -> Any:
        return (rows(x.ravel()) - [25.0, 40.0])[::-1].reshape(-1, 1)

    def cJx(self, x: Any) -> Any:  # noqa: N802
        return self.cx(x), lil_matrix(jacobian(x.ravel())[::-1])

    def cJHx(self, x: Any) -> Any:  # noqa: N802
        return *self.cJx(x), [lil_matrix(part) for part in row_hessians(x.ravel())[::-1]]
