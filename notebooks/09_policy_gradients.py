# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Exact policy gradients and REINFORCE
#
# Along every history of losses, states and probabilities are smooth functions of a policy's
# parameters, so the gradient of the success can be computed without sampling. This notebook trains
# a small policy by it, and by REINFORCE, the sampled gradient of Williams (1992), and compares both
# with the policies `leader` and `joint` and with the bound of all policies.

# %%
# %matplotlib inline
import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import casswarm as csw

scenario = csw.load_scenario("barricade")
guide = csw.plan(scenario)
n, steps, dt = scenario.n, scenario.n_steps, scenario.time.dt

# %% [markdown]
# ## A small policy
#
# Every member heads for a point beside the guide. Its offset from the guide is linear in time
# between five knots: at the first one it is where the member starts, and at the others there are
# two parameters each, 40 in all. At zero, all members gather at the guide.

# %%
KNOTS = 5
path = np.stack([guide.reference(step) for step in range(steps + 1)])
knots = np.linspace(0, steps, KNOTS)
hats = np.array([np.interp(np.arange(steps + 1), knots, row) for row in np.eye(KNOTS)]).T
offsets = scenario.positions - path[0]


def beside_guide(step, positions, previous_velocities, alive, parameters):
    """Velocities (n, 2) to the guide's next point and every member's offset from it."""
    shifts = ca.reshape(parameters, 2 * n, KNOTS - 1) @ ca.DM(hats[step + 1, 1:])
    goals = path[step + 1] + hats[step + 1, 0] * offsets
    return (ca.DM(goals) + ca.reshape(shifts, 2, n).T - positions) / dt


start = csw.ParametricPolicy(beside_guide, np.zeros(2 * n * (KNOTS - 1)), scenario, "trained")
csw.success_gradient(scenario, start, guide=guide)

# %% [markdown]
# The gradient agrees with central differences. They are taken at random parameters: at zero all
# members fly with the guide's highest speed, which is the limit of theirs, and there the success
# has a kink.

# %%
rng = np.random.default_rng(0)
point, direction = rng.normal(size=(2, start.parameters.size))
point *= 0.02
exact = csw.success_gradient(scenario, start, point, guide=guide, tolerance=0, aggregation_tol=0)
high, low = (
    csw.success_gradient(
        *(scenario, start, point + side * 1e-6 * direction),
        guide=guide,
        tolerance=0,
        aggregation_tol=0,
    ).objective
    for side in (1, -1)
)
print(f"gradient {exact.gradient @ direction:.8f}, difference {(high - low) / 2e-6:.8f}")

# %% [markdown]
# ## Training by the exact gradient
#
# Adam ascends the exact success. Arrivals are smoothed over a fifth of the target's radius, so that
# the gradient shows when a member is about to miss the target; the smoothed success is never more
# than the success. The cost is counted in *decisions*: evaluations of the policy in a state.

# %%
SMOOTHING = 0.2 * scenario.target.radius


def adam(parameters, gradient, updates, rate):
    """Ascend; yields the parameters and the number of decisions after every update."""
    first, second, decisions = np.zeros_like(parameters), np.zeros_like(parameters), 0
    for k in range(1, updates + 1):
        found, spent = gradient(parameters)
        decisions += spent
        first, second = 0.9 * first + 0.1 * found, 0.99 * second + 0.01 * found**2
        scaled = first / (1 - 0.9**k) / (np.sqrt(second / (1 - 0.99**k)) + 1e-12)
        parameters = parameters + rate * scaled
        yield parameters, decisions


def exact_gradient(parameters):
    """The gradient, and the number of states in which the policy decided."""
    found = csw.success_gradient(
        scenario, start, parameters, arrival_smoothing=SMOOTHING, guide=guide
    )
    return found.gradient, found.states


def exact_success(parameters):
    """Lower end of the exact success."""
    return csw.evaluate(scenario, start.with_parameters(parameters), guide=guide).success.low


def curve(updates, every):
    """Decisions, and exact success, at every so many updates; and the last parameters."""
    points = [(0, exact_success(start.parameters))]
    for k, (parameters, decisions) in enumerate(updates, start=1):
        if k % every == 0:
            points.append((decisions, exact_success(parameters)))
    return np.array(points), parameters


by_gradient, trained = curve(adam(start.parameters, exact_gradient, 60, 0.03), every=2)
print(f"success {by_gradient[0, 1]:.4f} -> {by_gradient[-1, 1]:.4f}")

# %% [markdown]
# ## Training by REINFORCE
#
# REINFORCE needs a policy that explores: independent normal noise is added to the function's
# velocities, which are then projected. The gradient of the logarithm of a run's probability is the
# sum over its steps of the noise, divided by its variance, times the derivative of the function.
# The mean of these, weighted by the run's success minus the mean success, estimates the gradient of
# the noisy policy's success. The runs are sampled from the chain itself; what is plotted is the
# exact success of the policy without noise.
#
# Sigma was chosen from 0.1, 0.2 and 0.4, and the rate for either number of runs from 0.003, 0.01
# and 0.03, by trials of 40 updates with 50 runs and of 60 with 500, with the seeds below. The
# choice is within 0.001 of the best trial. The rate of the exact gradient, 0.03, was not tuned.

# %%
SIGMA = 0.2
velocity = guide.velocities[0]


def sampled_gradient(runs, seed):
    """A function that estimates the gradient from a number of runs."""
    rng = np.random.default_rng(seed)

    def gradient(parameters):
        policy, decisions, history = start.with_parameters(parameters), 0, []
        positions = np.tile(scenario.positions, (runs, 1, 1))
        previous = np.tile(velocity, (runs, n, 1))
        alive, going = np.ones((runs, n), bool), np.ones(runs, bool)
        arrived = np.zeros(runs, bool)
        for step in range(steps):
            noise = rng.normal(size=positions.shape)
            state = positions, previous, alive & going[:, None]
            history.append((step, state, noise / SIGMA))
            decisions += going.sum()
            commanded = policy.commanded(step, *state) + SIGMA * noise
            previous = policy.motion.sets(previous).project(commanded)
            positions = positions + dt * previous
            survival = np.exp(-dt * scenario.hazard.rates(positions, alive))
            alive = alive & (rng.random(alive.shape) < survival)
            arrived |= going & (alive & scenario.target.contains(positions)).any(axis=1)
            going &= alive.any(axis=1) & ~arrived
            positions, previous = (
                np.where(alive[..., None], array, 0.0) for array in (positions, previous)
            )
            if not going.any():
                break
        advantage = (arrived - arrived.mean()) / (runs - 1)
        estimate = sum(policy.adjoint(*entry, advantage)[2] for entry in history)
        return estimate, decisions

    return gradient


budget = int(by_gradient[-1, 0])
same, _ = curve(adam(start.parameters, sampled_gradient(50, seed=1), 40, 0.003), every=4)
large, _ = curve(adam(start.parameters, sampled_gradient(500, seed=2), 120, 0.01), every=12)
print(f"decisions: exact gradient {budget}, REINFORCE {same[-1, 0]:.0f} and {large[-1, 0]:.0f}")

# %% [markdown]
# ## Comparison

# %%
leader, joint = (csw.evaluate(scenario, name, guide=guide).success for name in ("leader", "joint"))
bound = csw.success_bound(scenario)

figure, axes = plt.subplots(figsize=(7, 4))
curves = {
    "exact gradient": by_gradient,
    "REINFORCE, 50 runs an update": same,
    "REINFORCE, 500 runs an update": large,
}
for label, points in curves.items():
    axes.plot(np.maximum(points[:, 0], 100), points[:, 1], marker=".", label=label)
for label, value in {"leader": leader.low, "joint": joint.low, "bound": bound.value}.items():
    axes.axhline(value, color="0.5", linestyle=":", linewidth=1)
    axes.annotate(f" {label}", (1, value), xycoords=("axes fraction", "data"), va="center")
axes.set(xscale="log", xlabel="decisions", ylabel="exact success")
axes.legend(loc="center right", bbox_to_anchor=(1, 0.78))
figure

# %% [markdown]
# **Findings.** With the exact gradient, the small policy passes `leader` after a few updates and
# comes close to `joint`, whose paths have many more degrees of freedom. On the same budget of
# decisions REINFORCE does not improve on the start: 50 runs say little about 40 parameters. With
# 500 runs an update it needs more than ten times the budget to pass `leader`, and is still behind.
# The bound says how much a policy could gain at most.
