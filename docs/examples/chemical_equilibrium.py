"""Chemical equilibrium: a program of another field, in batches and by several solvers.

The mixture of ten species in which burning hydrazine is in equilibrium has the least Gibbs energy
of all mixtures of the same atoms (W. B. White, S. M. Johnson, G. B. Dantzig, J. Chem. Phys. 28(5),
1958; problem 112 of Hock and Schittkowski):

    minimise    sum over j of x_j (c_j + log(P / P_0) + log(x_j / sum of x))
    over        amounts x >= 1e-6 of the species
    subject to  A x = b, the amounts of hydrogen, nitrogen and oxygen

at 3500 K. It is posed for many pressures P and amounts b of oxygen. Only the general half of
casswarm is used, which knows no swarm.
"""

import casadi as ca
import numpy as np

from casswarm import comparison, nlp, solvers

SPECIES = ("H", "H2", "H2O", "N", "N2", "NH", "NO", "O", "O2", "OH")
ENERGIES = (-6.089, -17.164, -34.054, -5.914, -24.721, -14.986, -24.1, -10.708, -26.662, -22.179)
ATOMS = np.array(
    [
        [1, 2, 2, 0, 0, 1, 0, 0, 0, 1],  # hydrogen
        [0, 0, 0, 1, 2, 1, 1, 0, 0, 0],  # nitrogen
        [0, 0, 1, 0, 0, 0, 1, 1, 2, 1],  # oxygen
    ]
)
REFERENCE = 51.0  # atm, the pressure of the energies
SOLVERS = ("interior-point", "ipopt", "sqp")


def equilibrium() -> nlp.Nlp:
    """The program; its parameter is the logarithm of the pressure over the reference."""
    amounts, pressure = ca.SX.sym("amounts", len(SPECIES)), ca.SX.sym("pressure")
    potentials = ca.DM(ENERGIES) + pressure + ca.log(amounts / ca.sum1(amounts))
    balance = ca.mtimes(ca.DM(ATOMS), amounts)
    energy = ca.dot(amounts, potentials)
    return nlp.Nlp.from_expressions("equilibrium", amounts, pressure, energy, balance)


def mixtures(pressures: np.ndarray, oxygen: np.ndarray) -> nlp.Instances:
    """An instance for each pressure in atm and amount of oxygen, (B,)."""
    atoms = np.stack([np.full_like(oxygen, 2.0), np.ones_like(oxygen), oxygen], axis=1)
    return nlp.Instances(
        x0=np.full((len(oxygen), len(SPECIES)), 0.1),
        p=np.log(pressures / REFERENCE)[:, None],
        lbx=np.full((1, len(SPECIES)), 1e-6),
        ubx=np.full((1, len(SPECIES)), np.inf),
        lbg=atoms,
        ubg=atoms,
    )


def main() -> None:
    """Solve a thousand mixtures, and compare solvers on two of them."""
    program = equilibrium()
    published = solvers.make_solver("interior-point").solve_batch(
        program, mixtures(np.array([REFERENCE]), np.ones(1))
    )
    print(f"published mixture: energy {published.objective[0]:.4f}")
    rng = np.random.default_rng(0)
    some = mixtures(rng.uniform(10.0, 200.0, 1000), rng.uniform(0.5, 2.0, 1000))
    batch = solvers.make_solver("interior-point").solve_batch(program, some)
    print(f"{batch.success.sum()} of {len(some)} mixtures solved")
    problems = [
        comparison.Problem(f"mixture {i}", "equilibria", program, {"even": some[i : i + 1]})
        for i in range(2)
    ]
    compared = comparison.compare(problems, SOLVERS, time_limit=20.0, record_iterates=False)
    print(compared.summary[["solver", "solved", "best_known"]].to_string(index=False))


if __name__ == "__main__":
    main()
