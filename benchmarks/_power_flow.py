"""Optimal power flow, from files of the Power Grid Library (PGLib-OPF).

PGLib-OPF (S. Babaeinejadsarookolaee et al., arXiv:1908.02788; data under CC BY 4.0) has networks in
the format of MATPOWER, and publishes the objectives that it found. The model is the alternating
current one in polar coordinates: voltages and outputs of generators are variables, flows on
branches are expressions of them.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np

import casswarm as csw

FAR = 2 * np.pi
"""Differences of angles of at least this many radians are not limited."""


class Case(NamedTuple):
    """Tables of a file, with the elements that are in service: columns as in MATPOWER's manual."""

    name: str
    base: float
    bus: np.ndarray
    gen: np.ndarray
    gencost: np.ndarray
    branch: np.ndarray


def read_case(path: Path) -> Case:
    """Read a file `.m`. ValueError names what it lacks, or what is not treated."""
    text = re.sub(r"%.*", "", path.read_text())
    base = re.search(r"mpc\.baseMVA\s*=\s*([^;]+);", text)
    tables = {
        name: np.array([row.split() for row in body.split(";") if row.strip()], float)
        for name, body in re.findall(r"mpc\.(\w+)\s*=\s*\[(.*?)\]", text, re.DOTALL)
    }
    missing = [name for name in ("bus", "gen", "gencost", "branch") if name not in tables]
    if missing or not base:
        raise ValueError(f"{path}: mpc.{(missing or ['baseMVA'])[0]} is missing")
    bus, gen, cost, branch = (tables[name] for name in ("bus", "gen", "gencost", "branch"))
    if (cost[:, 0] != 2).any() or (cost[:, 3] > 3).any():
        raise ValueError(f"{path}: costs are no polynomials of degree 2")
    on, known = gen[:, 7] > 0, bus[bus[:, 1] != 4]
    return Case(path.stem, float(base[1]), known, gen[on], cost[on], branch[branch[:, 10] > 0])


def published(baseline: Path) -> dict[str, float]:
    """Objectives of PGLib's file BASELINE.md, by the name of the case; nan where there is none."""
    found = {}
    for line in baseline.read_text().splitlines():
        cells = [cell.strip() for cell in line.split("|")]
        if len(cells) > 6 and cells[1].startswith("pglib_opf_case"):
            number = re.fullmatch(r"[\d.]+e[+-]\d+", cells[5])
            found[cells[1]] = float(number[0]) if number else np.nan
    return found


def power_flow(case: Case) -> csw.Problem:
    """The optimal power flow of a case, in units of its base power and 1 % of its initial cost."""
    bus, gen, branch = case.bus, case.gen, case.branch
    index = {int(number): i for i, number in enumerate(bus[:, 0])}
    va, vm = ca.SX.sym("va", len(bus)), ca.SX.sym("vm", len(bus))
    pg, qg = ca.SX.sym("pg", len(gen)), ca.SX.sym("qg", len(gen))
    ends = [[index[int(number)] for number in branch[:, column]] for column in (0, 1)]
    flows = [_flows(branch, va, vm, first, ends) for first in (0, 1)]
    balances = []
    for output, load, shunt, part in ((pg, 2, bus[:, 4], 0), (qg, 3, -bus[:, 5], 1)):
        injected = -(bus[:, load] + shunt * vm**2) / case.base
        for i, number in enumerate(gen[:, 0]):
            injected[index[int(number)]] += output[i]
        for end, flow in zip(ends, flows, strict=True):
            for k, at in enumerate(end):
                injected[at] -= flow[part][k]
        balances.append(injected)
    limited = np.flatnonzero(branch[:, 5] > 0).tolist()
    rates = branch[:, 5] / case.base
    shares = [(p[k] ** 2 + q[k] ** 2) / rates[k] ** 2 for p, q in flows for k in limited]
    angles = va[ends[0]] - va[ends[1]]
    low, high = np.deg2rad(branch[:, 11]), np.deg2rad(branch[:, 12])
    none = np.full(len(shares), -np.inf)
    active, reactive = (gen[:, 8] + gen[:, 9]) / 2, (gen[:, 3] + gen[:, 4]) / 2
    lbva = np.where(bus[:, 1] == 3, 0.0, -np.inf)
    cost, start = _cost(case, pg * case.base), active / case.base
    unit = float(ca.Function("cost", [pg], [cost])(start))
    problem = csw.Problem.from_casadi(
        {
            "x": ca.vertcat(va, vm, pg, qg),
            "f": cost,
            "g": ca.vertcat(*balances, *shares, angles),
        },
        case.name,
        x0=[*np.zeros(len(bus)), *np.ones(len(bus)), *start, *reactive / case.base],
        lbx=[*lbva, *bus[:, 12], *gen[:, 9] / case.base, *gen[:, 4] / case.base],
        ubx=[*-lbva, *bus[:, 11], *gen[:, 8] / case.base, *gen[:, 3] / case.base],
        lbg=[*np.zeros(2 * len(bus)), *none, *np.where(low <= -FAR, -np.inf, low)],
        ubg=[*np.zeros(2 * len(bus)), *np.ones(len(shares)), *np.where(high >= FAR, np.inf, high)],
        family="power flow",
    )
    (instance,) = problem.starts.values()
    starts = {"given": replace(instance, scale=np.array([[1.0, unit / 100.0]]))}
    return replace(problem, starts=starts)


def _cost(case: Case, megawatts: ca.SX) -> ca.SX:
    """Costs in dollars an hour."""
    total = ca.SX(0)
    for i, row in enumerate(case.gencost):
        total += ca.polyval(ca.DM(row[4 : 4 + int(row[3])]), megawatts[i])
    return total


def _flows(
    branch: np.ndarray, va: ca.SX, vm: ca.SX, first: int, ends: list[list[int]]
) -> tuple[ca.SX, ca.SX]:
    """Active and reactive power that enters the branches at their ends `first`."""
    admittance = 1.0 / (branch[:, 2] + 1j * branch[:, 3])
    tap = np.where(branch[:, 8] == 0.0, 1.0, branch[:, 8])
    ratio = tap * np.exp(1j * np.deg2rad(branch[:, 9]))
    own = admittance + 0.5j * branch[:, 4]
    if first == 0:
        own, mutual = own / tap**2, -admittance / ratio.conj()
    else:
        mutual = -admittance / ratio
    here, there = ends[first], ends[1 - first]
    product, angle = vm[here] * vm[there], va[here] - va[there]
    cosine, sine = product * ca.cos(angle), product * ca.sin(angle)
    square = vm[here] ** 2
    active = own.real * square + mutual.real * cosine + mutual.imag * sine
    reactive = -own.imag * square - mutual.imag * cosine + mutual.real * sine
    return active, reactive
