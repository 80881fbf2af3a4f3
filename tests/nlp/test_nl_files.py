"""Files in AMPL's .nl format: written, read, refused."""

from __future__ import annotations

import struct
from contextlib import suppress
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from hock_schittkowski import NUMBERS, published
from hypothesis import given, settings
from hypothesis import strategies as st
from known_problems import INF, instances

from casswarm.errors import ProblemError
from casswarm.nlp import Instances, Nlp, nl_bytes, nl_text, operations, read_nl

HEADER = (
    "g3 1 1 0\t# problem small",
    " 2 1 1 0 0\t# vars, constraints, objectives, ranges, eqns",
    " 1 1\t# nonlinear constraints, objectives",
    " 0 0\t# network constraints: nonlinear, linear",
    " 2 2 2\t# nonlinear vars in constraints, objectives, both",
    " 0 0 0 1\t# linear network variables; functions; arith, flags",
    " 0 0 0 0 0\t# discrete variables: binary, integer, nonlinear (b,c,o)",
    " 2 1\t# nonzeros in Jacobian, gradients",
    " 0 0\t# max name lengths: constraints, variables",
    " 1 0 0 0 0\t# common exprs: b,c,o,c1,o1",
)
BODY = """V2 1 0
1 3
o5\t#^
v0\t#x
n2
C0
o2
v2
v2
O0 1
o16
v0
S0 1 scaling_factor
0 2.5
d1
0 1
x1
0 3
r
1 4.5
b
3
0 -1 5
k1
1
J0 2
0 0
1 10
G0 1
0 7
"""
SMALL = "\n".join(HEADER) + "\n" + BODY


def read(folder: Path, text: str | bytes) -> tuple[Nlp, Instances]:
    path = folder / "problem.nl"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return read_nl(path, "problem")


def program(objective, rows=(), size: int = 2) -> tuple[Nlp, Instances]:
    """Program of functions of x, and an instance with infinite bounds."""
    x = ca.SX.sym("x", size)
    g = ca.vertcat(*(row(x) for row in rows)) if rows else ca.SX(0, 1)
    nlp = Nlp.from_expressions("made", x, ca.SX(0, 1), ca.SX(objective(x)), g)
    free = np.full(len(rows), INF)
    return nlp, instances(np.ones(size), lbg=-free, ubg=free)


def binary(order: str = "<", kind: int = 1) -> bytes:
    """The small problem as a binary file: every field by itself, in an order of bytes."""
    fields = (
        *(b"V", 2, 1, 0, 1, 3.0, b"o", 5, b"v", 0, b"s", np.int16(2)),
        *(b"C", 0, b"o", 2, b"v", 2, b"v", 2, b"O", 0, 1, b"o", 16, b"v", 0),
        *(b"S", 4, 1, 14, b"scaling_factor", 0, 2.5, b"S", 0, 1, 3, b"key", 0, 1),
        *(b"d", 1, 0, 1.0, b"x", 1, 0, 3.0, b"r", b"1", 4.5, b"b", b"3", b"0", -1.0, 5.0),
        *(b"k", 1, 1, b"J", 0, 2, 0, 0.0, 1, 10.0, b"G", 0, 1, 0, 7.0),
    )
    codes = {int: "i", float: "d", np.int16: "h"}
    header = "\n".join(HEADER).replace("g3", "b3").replace("0 0 0 1\t", f"0 0 {kind} 1\t") + "\n"
    body = (
        field if isinstance(field, bytes) else struct.pack(order + codes[type(field)], field)
        for field in fields
    )
    return header.encode() + b"".join(body)


def values(nlp: Nlp, x) -> list[np.ndarray]:
    """f, g, gradient and Jacobian at a point."""
    parts = (*nlp.evaluate(x, []), nlp.gradient(x, [])[1], nlp.jacobian(x, []))
    return [np.asarray(ca.densify(part)) for part in parts]


# --- reading


def test_read_nl_takes_terms_bounds_and_sense(tmp_path: Path) -> None:
    nlp, instance = read(tmp_path, SMALL)
    f, g, gradient, jacobian = values(nlp, [2.0, 1.0])
    assert f == -(-2 + 7 * 2)  # of a maximum, the negative
    assert g == (2**2 + 3) ** 2 + 10
    np.testing.assert_allclose(gradient.ravel(), [-6, 0])
    np.testing.assert_allclose(jacobian, [[2 * 7 * 4, 2 * 7 * 3 + 10]])
    assert instance.x0.tolist() == [[3, 0]]
    assert instance.lbx.tolist() == [[-np.inf, -1]]
    assert instance.ubx.tolist() == [[np.inf, 5]]
    assert (instance.lbg.tolist(), instance.ubg.tolist()) == ([[-np.inf]], [[4.5]])


def test_read_nl_without_objective_minimises_zero(tmp_path: Path) -> None:
    header = [
        line.replace(" 2 1 1 0 0", " 2 1 0 0 0").replace(" 2 1\t", " 2 0\t") for line in HEADER
    ]
    body = BODY.replace("O0 1\no16\nv0\n", "").replace("G0 1\n0 7\n", "")
    nlp, _ = read(tmp_path, "\n".join(header) + "\n" + body)
    assert float(nlp.evaluate([2, 1], [])[0]) == 0


EXPRESSIONS = {
    "o6\nv0\nv1": lambda a, b: max(a - b, 0),
    "o4\nv0\nv1": np.fmod,
    "o55\no16\nv0\nv1": lambda a, b: np.trunc(-a / b),
    "o42\nv0": lambda a, _: np.log10(a),
    "o11\n3\nv0\nv1\nn0.5": lambda a, b: min(a, b, 0.5),
    "o12\n3\nv0\nv1\nn0.5": lambda a, b: max(a, b, 0.5),
    "o54\n3\nv0\nv1\nl100": lambda a, b: a + b + 100,
    "o35\no29\nv0\nv1\nv0\ns7": lambda a, b: a if a > b else 7,
    "o35\no70\n2\no28\nv0\nv1\no23\nv1\nn1\nn1\nn0": lambda a, b: float(a >= b and b <= 1),
    "o35\no34\no71\n2\no22\nv0\nv1\no24\nv1\nn1\nn1\nn0": lambda a, b: float(a >= b and b != 1),
}


@pytest.mark.parametrize("expression", EXPRESSIONS)
def test_read_nl_evaluates_operators(tmp_path: Path, expression: str) -> None:
    nlp, _ = read(tmp_path, SMALL.replace("O0 1\no16\nv0", f"O0 0\n{expression}"))
    for a, b in ((2.5, 0.7), (0.4, 0.9), (0.3, 1.0)):
        expected = EXPRESSIONS[expression](a, b) + 7 * a
        assert float(nlp.evaluate([a, b], [])[0]) == pytest.approx(expected)


REFUSED = {
    "text as binary": (SMALL.replace("g3", "b3", 1), "byte 494: the file has '540090418' where a"),
    "no nl": ("hello\n" + SMALL, "line 1: the file is no .nl file"),
    "not text": (b"g3 \xff", "bytes that are not ASCII"),
    "empty": ("", "ends too early: is it truncated"),
    "integers": (SMALL.replace(" 0 0 0 0 0\t#", " 0 2 0 0 0\t#"), "has 2 integer variables"),
    "objectives": (SMALL.replace(" 2 1 1 0 0", " 2 1 3 0 0"), "has 3 objectives"),
    "logical": (SMALL.replace(" 2 1 1 0 0", " 2 1 1 0 0 4"), "has 4 logical constraints"),
    "complementary": (SMALL.replace(" 1 1\t#", " 1 1 1 2 0 0\t#"), "3 complementarity conditions"),
    "complements": (SMALL.replace("1 4.5", "5 1 1"), "has a complementarity condition"),
    "functions": (SMALL.replace(" 0 0 0 1\t#", " 0 1 0 1\t#"), "imports 1 function of"),
    "import": (SMALL.replace("C0\n", "F0 1 2 gsl\nC0\n"), "imports a function of a library"),
    "call": (SMALL.replace("o16\nv0", "o16\nf0 1"), "calls an imported function"),
    "logical row": (SMALL.replace("C0\n", "L0\n"), "has a logical constraint"),
    "sets": (SMALL.replace("scaling_factor", "sosno"), "special ordered sets"),
    "pieces": (SMALL.replace("o16", "o64"), "has the operator o64 (a piecewise-linear term)"),
    "operator": (SMALL.replace("o16", "o99"), "operator o99 (which the format does not know)"),
    "no terms": (SMALL.replace("o16\nv0", "o54\n0"), "operator o54"),
    "undefined": (SMALL.replace("v2\nv2", "v2\nv9"), "uses v9, which is neither a variable nor"),
    "twice": (SMALL.replace("V2", "V1"), "defines v1 twice"),
    "segment": (SMALL.replace("k1\n", "q1\n"), "has 'q1' where a segment should begin"),
    "variable": (SMALL.replace("J0 2\n0 0", "J0 2\n2 0"), "'2' where a whole number from 0 to 1"),
    "row": (SMALL.replace("C0\n", "C1\n"), "'1' where a whole number from 0 to 0"),
    "number": (SMALL.replace("n2", "ntwo"), "has 'two' where 1 numbers are expected"),
    "kind": (SMALL.replace("1 4.5", "7 4.5"), "bounds of a kind that the format does not know"),
    "claims": (
        SMALL.replace(" 2 1 1 0 0", " 999999999 1 1 0 0"),
        "too few for 999999999 variables",
    ),
    "digits": (SMALL.replace("x1\n", f"x{'9' * 5000}\n"), "where a whole number"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_read_nl_refusal_names_file_and_reason(tmp_path: Path, name: str) -> None:
    text, reason = REFUSED[name]
    with pytest.raises(ProblemError) as refusal:
        read(tmp_path, text)
    assert str(tmp_path / "problem.nl") in str(refusal.value)
    assert reason in str(refusal.value)
    assert refusal.value.file == tmp_path / "problem.nl"


@pytest.mark.parametrize("line", ["S0 1 ", "C", "k1\n", "J0 "])
def test_read_nl_refusal_quotes_at_most_a_few_words(tmp_path: Path, line: str) -> None:
    with pytest.raises(ProblemError) as refusal:
        read(tmp_path, SMALL.replace("x1\n", f"{line}{'9 ' * 50_000}\nx1\n"))
    assert len(str(refusal.value)) < 200 + len(str(tmp_path))


def test_read_nl_refuses_every_truncated_file(tmp_path: Path) -> None:
    lines = SMALL.splitlines(keepends=True)
    for count in range(len(lines)):
        with pytest.raises(ProblemError, match="truncated"):
            read(tmp_path, "".join(lines[:count]))


@given(st.integers(0, len(SMALL) - 1), st.sampled_from("0123456789 \novnxrbkJGCVS-.e\t#"))
def test_read_nl_of_changed_file_reads_or_refuses(tmp_path_factory, at: int, char: str) -> None:
    folder = tmp_path_factory.getbasetemp()
    with suppress(ProblemError):
        nlp, instance = read(folder, SMALL[:at] + char + SMALL[at + 1 :])
        assert instance.x0.shape[1] == nlp.sizes[0]


@pytest.mark.parametrize(("order", "kind"), [("<", 0), ("<", 1), (">", 2)])
def test_read_nl_of_binary_file_is_that_of_the_text(tmp_path: Path, order: str, kind: int) -> None:
    (nlp, instance), (again, same) = read(tmp_path, SMALL), read(tmp_path, binary(order, kind))
    for one, two in zip(values(nlp, [2.0, 1.0]), values(again, [2.0, 1.0]), strict=True):
        np.testing.assert_array_equal(one, two)
    for part in ("x0", "lbx", "ubx", "lbg", "ubg"):
        np.testing.assert_array_equal(getattr(same, part), getattr(instance, part))


def test_read_nl_refuses_every_truncated_binary_file(tmp_path: Path) -> None:
    content = binary()
    for count in range(len(content)):
        with pytest.raises(ProblemError, match=r"truncated|first line does not begin"):
            read(tmp_path, content[:count])


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ((b"0 0 1 1\t", b"0 0 3 1\t"), "numbers of the kind 3; only IEEE is supported"),
        ((b"\x0e\0\0\0scaling_factor", b"\x05\0\0\0sosno"), "special ordered sets"),
        ((b"o\x10", b"o\x63"), "operator o99"),
        ((b"k\x01", b"q\x01"), "has 'q' where a segment should begin"),
        ((b"x\x01\0\0\0", b"x\x01\0\0\x80"), "has '-2147483647' where a whole number"),
        ((b"O\0", b"Oh"), "where a whole number from 0 to 0 is expected"),
    ],
)
def test_read_nl_refusal_of_binary_file_names_the_reason(tmp_path: Path, change, reason) -> None:
    content = binary()
    assert content.count(change[0]) == 1
    with pytest.raises(ProblemError) as refusal:
        read(tmp_path, content.replace(*change))
    assert reason in str(refusal.value)
    assert refusal.value.file == tmp_path / "problem.nl"


@given(st.integers(0, len(binary()) - 1), st.integers(0, 255))
def test_read_nl_of_changed_binary_file_reads_or_refuses(tmp_path_factory, at, byte) -> None:
    content = bytearray(binary())
    content[at] = byte
    with suppress(ProblemError):
        nlp, instance = read(tmp_path_factory.getbasetemp(), bytes(content))
        assert instance.x0.shape[1] == nlp.sizes[0]


def test_read_nl_takes_deep_expressions(tmp_path: Path) -> None:
    deep = "o0\nn1\n" * 5_000 + "v0"
    nlp, _ = read(tmp_path, SMALL.replace("O0 1\no16\nv0", f"O0 0\n{deep}"))
    assert float(nlp.evaluate([2, 1], [])[0]) == 5_000 + 2 + 14


def test_read_nl_refuses_pipes_and_folders(tmp_path: Path) -> None:
    with pytest.raises(ProblemError, match="fifo, a socket or a device"):
        read_nl(Path("/dev/zero"), "zero")
    with pytest.raises(ProblemError, match="directory"):
        read_nl(tmp_path, "folder")


# --- writing, and reading again


@pytest.mark.parametrize("number", NUMBERS)
def test_written_problem_is_read_as_the_same(tmp_path: Path, number: int) -> None:
    case = published(number)
    text = nl_text(case.nlp, case.instance)
    nlp, instance = read(tmp_path, text)
    for part in ("x0", "lbx", "ubx", "lbg", "ubg"):
        np.testing.assert_array_equal(getattr(instance, part), getattr(case.instance, part))
    builder = ca.NlpBuilder()  # CasADi's own reader
    builder.import_nl(str(tmp_path / "problem.nl"))
    from_binary, same = read(tmp_path, nl_bytes(case.nlp, case.instance))
    for part in ("x0", "lbx", "ubx", "lbg", "ubg"):
        np.testing.assert_array_equal(getattr(same, part), getattr(instance, part))
    x = ca.vertcat(*builder.x)
    g = ca.vertcat(ca.MX(0, 1), *builder.g)
    other = Nlp.from_expressions("other", x, ca.MX(0, 1), ca.MX(builder.f), g)
    assert [builder.x_lb, builder.g_ub] == [instance.lbx[0].tolist(), instance.ubg[0].tolist()]
    generator = np.random.default_rng(number)
    for _ in range(3):
        point = case.instance.x0[0] + 0.1 * generator.normal(size=case.instance.x0.shape[1])
        expected = values(case.nlp, point)
        for one, two in zip(values(nlp, point), values(from_binary, point), strict=True):
            np.testing.assert_array_equal(one, two)
        for again in (values(nlp, point), values(other, point)):
            for one, two in zip(expected, again, strict=True):
                np.testing.assert_allclose(two, one, rtol=1e-10, atol=1e-10)


WRITTEN = [code for code, each in operations.OPERATIONS.items() if each.nl and code != ca.OP_ASSIGN]
points = st.tuples(*[st.floats(0.05, 0.95)] * 2)


@pytest.mark.parametrize("operation", WRITTEN)
def test_every_operation_is_written(tmp_path: Path, operation: int) -> None:
    nlp, instance = program(lambda x: ca.SX.binary(operation, x[0], x[1]) + x[1])
    again, _ = read(tmp_path, nl_text(nlp, instance))
    shift = 1.0 if operation == ca.OP_ACOSH else 0.0
    for point in ([0.3, 0.8], [0.8, 0.3], [0.5, 0.5], [0.7, 1.0], [0.9, 0.0]):
        x = [point[0] + shift, point[1]]
        expected, found = nlp.evaluate(x, [])[0], again.evaluate(x, [])[0]
        np.testing.assert_allclose(float(found), float(expected), rtol=1e-12)


def test_table_has_every_operator_once() -> None:
    assert sorted(operations.OPERATORS) == [
        *(0, 1, 2, 3, 4, 5, 6, 11, 12, 13, 14, 15, 16, 20, 21, 22, 23, 24, 28, 29, 30, 34, 35, 37),
        *(38, 39, 40, 41, 42, 43, 44, 45, 46, 47, 48, 49, 50, 51, 52, 53, 54, 55, 70, 71),
    ]
    table = Path(operations.__file__).with_suffix(".csv").read_text()
    read = [line for line in table.splitlines()[1:] if not line.endswith(",")]
    assert len(read) == len(operations.OPERATORS)


terms = st.recursive(
    st.one_of(st.sampled_from(["x[0]", "x[1]"]), st.floats(-3, 3).map("({:.3f})".format)),
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from("+-*"), inner).map(lambda t: f"({' '.join(t)})"),
        inner.map("ca.sin({})".format),
        inner.map("({} ** 2 + 1)".format),
        inner.map("(1 / ({} ** 2 + 1))".format),
        st.tuples(inner, inner).map(lambda t: f"ca.fmin({t[0]}, {t[1]})"),
    ),
    max_leaves=12,
)


@settings(max_examples=30)
@given(terms, st.lists(terms, max_size=2), points)
def test_written_expressions_are_read_as_the_same(tmp_path_factory, objective, rows, x) -> None:
    functions = [eval(f"lambda x: {text}", {"ca": ca}) for text in (objective, *rows)]
    nlp, instance = program(functions[0], functions[1:])
    again, bounds = read(tmp_path_factory.getbasetemp(), nl_text(nlp, instance))
    assert np.isinf(bounds.lbg).all()
    for one, two in zip(values(nlp, x), values(again, x), strict=True):
        np.testing.assert_allclose(two, one, rtol=1e-9, atol=1e-9)


def test_linear_rows_are_written_as_linear_terms() -> None:
    nlp, instance = program(ca.sumsqr, [lambda x: ca.exp(x[1]), lambda x: 2 * x[0] - x[1]])
    lines = nl_text(nlp, instance).splitlines()
    assert lines[2].startswith(" 1 1\t")  # one nonlinear constraint
    assert lines[lines.index("C1") + 1] == "n0"
    at = lines.index("J1 2")
    assert lines[at + 1 : at + 3] == ["0 2", "1 -1"]


def test_shared_expressions_are_written_once() -> None:
    def powers(x):
        value = x[0] + x[1]
        for _ in range(60):  # 2^60 operations, written out
            value = ca.sin(value) * value
        return value

    assert len(nl_text(*program(powers)).splitlines()) < 1000


def test_unwritable_problem_is_refused() -> None:
    with pytest.raises(ProblemError, match=r"made cannot be written .*: it has CasADi's OP_ERF"):
        nl_text(*program(lambda x: ca.erf(x[0])))
    with pytest.raises(ProblemError, match=r"made cannot be written .*: it has the number inf"):
        nl_text(*program(lambda x: ca.if_else(x[0] > 0, x[0], np.inf)))
    x = ca.MX.sym("x")
    table = ca.interpolant("table", "bspline", [[0, 1, 2, 3, 4]], [0, 1, 4, 9, 16])
    nlp = Nlp.from_expressions("table", x, ca.MX(0, 1), table(x), ca.MX(0, 1))
    one = instances([1.0], lbx=-1.0, ubx=1.0)
    with pytest.raises(ProblemError, match=r"table cannot be written .* CasADi's OP_CALL"):
        nl_text(nlp, one)
    solved = ca.solve(ca.blockcat([[x, 1], [1, 3 * x]]), ca.MX.ones(2), "qr")
    nlp = Nlp.from_expressions("solve", x, ca.MX(0, 1), ca.sumsqr(solved), ca.MX(0, 1))
    with pytest.raises(ProblemError, match="it has an operation that is not one of scalars"):
        nl_text(nlp, one)
