"""Weights of a small model predictive controller, learned from its behaviour.

A cart at position 0 should reach position 0 with accelerations of at most 1 over ten steps. Its
weights of the position and of the acceleration are unknown; states and the accelerations that an
expert chose there are given. The program is a layer of PyTorch, whose gradient is exact.
"""

import casadi as ca
import numpy as np
import torch

from casswarm import nlp, solvers

STEPS, STEP = 10, 0.3
EXPERT = [3.0, 0.2]  # weights of the position and of the acceleration


def controller() -> tuple[nlp.Nlp, nlp.Instances]:
    """Accelerations of the least cost, from a state and two weights."""
    u, p = ca.SX.sym("u", STEPS), ca.SX.sym("p", 4)
    position, velocity, cost = p[0], p[1], ca.SX(0)
    for k in range(STEPS):
        position, velocity = position + STEP * velocity, velocity + STEP * u[k]
        cost += p[2] * position**2 + velocity**2 + p[3] * u[k] ** 2
    program = nlp.Nlp.from_expressions("controller", u, p, cost, ca.SX(0, 1))
    limits = np.ones(STEPS)
    none = np.empty(0)
    instances = nlp.Instances(np.zeros((1, STEPS)), np.ones(4), -limits, limits, none, none)
    return program, instances


def learn(steps: int = 200) -> list[float]:
    """Weights that reproduce the expert's accelerations."""
    act = solvers.layer(*controller(), framework="torch")
    states = torch.tensor(np.random.default_rng(0).uniform(-1, 1, (64, 2)))

    def actions(weights: torch.Tensor) -> torch.Tensor:
        return act(torch.hstack([states, weights.expand(64, 2)]))[:, 0]

    data, logarithms = actions(torch.tensor(EXPERT)), torch.zeros(2, requires_grad=True)
    optimiser = torch.optim.Adam([logarithms], lr=0.1)
    for _ in range(steps):
        optimiser.zero_grad()
        loss = ((actions(logarithms.exp()) - data) ** 2).mean()
        loss.backward()
        optimiser.step()
    return logarithms.exp().tolist()


if __name__ == "__main__":
    print("weights:", [round(weight, 2) for weight in learn()])
