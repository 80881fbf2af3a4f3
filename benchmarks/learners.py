"""Three learners in three scenarios, five seeds each: exact success, and regret.

Run with the installed package, and with PyTorch, Stable-Baselines3 and TorchRL
(``pip install 'casswarm[rl]' torch stable-baselines3 torchrl``)::

    python benchmarks/learners.py                          # all, an hour on one core
    python benchmarks/learners.py gauntlet sb3 --seeds 1   # some, only printed

All of them are proximal policy optimisation (Schulman and others, 2017) with the shaped reward of
`casswarm.envs`: by Stable-Baselines3, by the loss and the advantages of TorchRL, and written out,
as CleanRL does. The first has a network for the whole swarm; the others have one that every member
applies to its own observation and index. They learn what is added to the velocity towards the
guide's reference (residual policies: Johannink and others, ICRA 2019): from velocities at random,
no run arrives in 300,000 steps. `guided` is the policy without training.

Success is not that of the training's runs: it has proven bounds, or (exact: False) an interval with
95 % confidence.

With all scenarios, learners and seeds, results/leaderboard/learners.csv is written, of which
``docs/leaderboard.md`` shows medians.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pandas as pd
import torch
from leaderboard import success_of
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from tensordict import TensorDict
from tensordict.nn import ProbabilisticTensorDictModule as Distributed
from tensordict.nn import ProbabilisticTensorDictSequential as Sequential
from tensordict.nn import TensorDictModule
from torch.distributions import Independent, Normal
from torchrl.modules import ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

import casswarm as csw
from casswarm import Guide, Scenario
from casswarm.envs import SwarmEnv, SwarmVectorEnv
from casswarm.policies import Observation

SCENARIOS = ("gauntlet", "barricade", "alley")
SEEDS = 5
STEPS = 150_000  # environment steps of a training
ENVIRONMENTS, HORIZON = 64, 32
EPOCHS, BATCHES = 6, 4
CLIP, ENTROPY, RATE, LAMBDA = 0.2, 0.0, 3e-4, 0.95
LOG_STD = -2.5  # logarithm of the exploration's standard deviation at first, in units of v_max
TABLE = Path(__file__).resolve().parents[1] / "results" / "leaderboard" / "learners.csv"


@dataclass(frozen=True, eq=False)
class Task:
    """What a learner is given."""

    scenario: Scenario
    guide: Guide
    seed: int
    steps: int

    @property
    def options(self) -> dict[str, Any]:
        """Of the environment."""
        return {"guide": self.guide, "observe_guide": True, "shaping": True}

    @property
    def observation(self) -> Observation:
        """Of the environment, and of the policy."""
        return Observation.from_scenario(self.scenario, guide=self.guide)

    @property
    def features(self) -> int:
        """Number of them, of every member."""
        return SwarmEnv(self.scenario, **self.options).observation_space.shape[-1]

    def towards_guide(self, observations: Any) -> Any:
        """Velocities to the guide's next reference, in units of v_max."""
        seen = self.observation
        gain = seen.length / (self.scenario.time.dt * seen.v_max)
        return (gain * observations[..., seen.slices["guide"]]).clip(-1.0, 1.0)


def network(inputs: int, outputs: int) -> torch.nn.Sequential:
    """Two hidden layers of orthogonal weights; outputs begin near zero."""
    layers = [torch.nn.Linear(*sizes) for sizes in ((inputs, 64), (64, 64), (64, outputs))]
    for layer, gain in zip(layers, (2**0.5, 2**0.5, 0.01), strict=True):
        torch.nn.init.orthogonal_(layer.weight, gain)
        torch.nn.init.zeros_(layer.bias)
    return torch.nn.Sequential(layers[0], torch.nn.Tanh(), layers[1], torch.nn.Tanh(), layers[2])


class Actor(torch.nn.Module):
    """Velocities (B, n, 2) in units of v_max: every member's from its observation and index.

    Without the index, members at one place would decide alike for ever.
    """

    def __init__(self, task: Task) -> None:
        super().__init__()
        self.task, self.mean = task, network(task.features + task.scenario.n, 2)
        self.log_std = torch.nn.Parameter(torch.full((2,), LOG_STD))

    def forward(self, observations: Any) -> tuple[Any, Any]:
        """Means and standard deviations; those of destroyed members are constant."""
        alive = observations[..., :1]
        index = torch.eye(observations.shape[-2]).expand(*observations.shape[:-2], -1, -1)
        added = self.mean(torch.cat([observations, index], -1))
        mean = (self.task.towards_guide(observations) + added) * alive
        return mean, (self.log_std * alive).exp().expand_as(mean)


class Critic(torch.nn.Module):
    """Value (B, 1) of the observations of all members."""

    def __init__(self, task: Task) -> None:
        super().__init__()
        self.value = network(task.scenario.n * task.features, 1)

    def forward(self, observations: Any) -> Any:
        """The value."""
        return self.value(observations.flatten(-2))


class Velocities(torch.nn.Module):
    """What `casswarm.as_policy` takes: observations to velocities, without noise."""

    def __init__(self, actor: Actor) -> None:
        super().__init__()
        self.actor = actor

    def forward(self, observations: Any) -> Any:
        """Velocities (B, n, 2)."""
        return self.actor.task.scenario.swarm.v_max * self.actor(observations)[0]


def rollout(env: SwarmVectorEnv, observations: Any, actor: Actor) -> TensorDict:
    """HORIZON steps (B, T) of all environments, which begin new runs in the same step."""
    steps, v_max = [], actor.task.scenario.swarm.v_max
    for _ in range(HORIZON):
        with torch.no_grad():
            distribution = Independent(Normal(*actor(observations)), 2)
            action = distribution.sample()
        following, reward, ended, _, _ = env.step(v_max * action.numpy())
        following = torch.as_tensor(following)
        done = torch.as_tensor(ended)[:, None]
        steps.append(
            TensorDict(
                {
                    "observation": observations,
                    "action": action,
                    "sample_log_prob": distribution.log_prob(action),
                    "next": {
                        "observation": following,
                        "reward": torch.as_tensor(reward, dtype=torch.float32)[:, None],
                        "done": done,
                        "terminated": done,
                    },
                },
                [len(done)],
            )
        )
        observations = following
    return torch.stack(steps, 1)


def rollouts(task: Task, actor: Actor) -> Iterator[TensorDict]:
    """Data of a training, collected by the actor as it is at the time."""
    env = SwarmVectorEnv(task.scenario, ENVIRONMENTS, autoreset_mode="SameStep", **task.options)
    observations = torch.as_tensor(env.reset(seed=task.seed)[0])
    for _ in range(task.steps // (ENVIRONMENTS * HORIZON)):
        data = rollout(env, observations, actor)
        observations = data["next", "observation"][:, -1]
        yield data


def minibatches(data: TensorDict) -> Iterator[TensorDict]:
    """Parts of the data in random order, EPOCHS times."""
    flat = data.reshape(-1)
    for _ in range(EPOCHS):
        for rows in torch.randperm(len(flat)).chunk(BATCHES):
            yield flat[rows]


def advantages(data: TensorDict, critic: Critic) -> None:
    """Write advantages and returns: generalised advantage estimation, without discount."""
    with torch.no_grad():
        values = critic(data["observation"])
        later = critic(data["next", "observation"]) * ~data["next", "done"]
    surprise = data["next", "reward"] + later - values
    total, found = torch.zeros_like(surprise[:, 0]), torch.zeros_like(surprise)
    for step in range(HORIZON - 1, -1, -1):
        total = surprise[:, step] + LAMBDA * total * ~data["next", "done"][:, step]
        found[:, step] = total
    data["advantage"], data["value_target"] = found, found + values


def written_out(task: Task) -> Any:
    """Proximal policy optimisation in some lines, as in CleanRL."""
    actor, critic = Actor(task), Critic(task)
    parameters = [*actor.parameters(), *critic.parameters()]
    optimiser = torch.optim.Adam(parameters, RATE)
    for data in rollouts(task, actor):
        advantages(data, critic)
        for part in minibatches(data):
            distribution = Independent(Normal(*actor(part["observation"])), 2)
            ratio = (distribution.log_prob(part["action"]) - part["sample_log_prob"]).exp()
            gain = part["advantage"][:, 0]
            gain = (gain - gain.mean()) / (gain.std() + 1e-8)
            clipped = torch.minimum(ratio * gain, ratio.clamp(1 - CLIP, 1 + CLIP) * gain)
            error = (critic(part["observation"]) - part["value_target"]).square().mean()
            loss = 0.5 * error - clipped.mean() - ENTROPY * distribution.entropy().mean()
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(parameters, 0.5)
            optimiser.step()
    return Velocities(actor)


def torchrl(task: Task) -> Any:
    """The same with the loss and the advantages of TorchRL."""
    actor, critic = Actor(task), Critic(task)
    policy = Sequential(
        TensorDictModule(actor, ["observation"], ["loc", "scale"]),
        Distributed(
            ["loc", "scale"],
            ["action"],
            distribution_class=lambda loc, scale: Independent(Normal(loc, scale), 2),
        ),
    )
    value = ValueOperator(critic, ["observation"])
    estimator = GAE(gamma=1.0, lmbda=LAMBDA, value_network=value)
    loss = ClipPPOLoss(policy, value, clip_epsilon=CLIP, entropy_coeff=ENTROPY, critic_coeff=0.5)
    loss.set_keys(sample_log_prob="sample_log_prob")
    loss.normalize_advantage = True
    optimiser = torch.optim.Adam(loss.parameters(), RATE)
    for data in rollouts(task, actor):
        with torch.no_grad():
            estimator(data)
        for part in minibatches(data):
            losses = loss(part)
            optimiser.zero_grad()
            sum(each for name, each in losses.items() if name.startswith("loss_")).backward()
            torch.nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
            optimiser.step()
    return Velocities(actor)


class Residual(gymnasium.Wrapper):
    """The environment of one swarm, with actions that are added to velocities to the guide."""

    def __init__(self, task: Task) -> None:
        super().__init__(SwarmEnv(task.scenario, **task.options))
        self.task, self.last = task, np.zeros(self.observation_space.shape)
        shape = self.env.action_space.shape
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, shape, np.float32)

    def reset(self, **options: Any) -> Any:
        """Begin a run."""
        self.last, infos = self.env.reset(**options)
        return self.last, infos

    def step(self, action: Any) -> Any:
        """Move the swarm."""
        velocities = self.task.towards_guide(self.last) + action
        answer = self.env.step(self.task.scenario.swarm.v_max * velocities)
        self.last = answer[0]
        return answer


def sb3(task: Task) -> Any:
    """Stable-Baselines3, with a network of the whole swarm's observations."""
    model = PPO(
        "MlpPolicy",
        make_vec_env(lambda: Residual(task), ENVIRONMENTS, seed=task.seed),
        learning_rate=RATE,
        n_steps=HORIZON,
        batch_size=ENVIRONMENTS * HORIZON // BATCHES,
        n_epochs=EPOCHS,
        gamma=1.0,
        gae_lambda=LAMBDA,
        ent_coef=ENTROPY,
        policy_kwargs={"log_std_init": LOG_STD},
        seed=task.seed,
        device="cpu",
    ).learn(task.steps)

    def velocities(observations: Any) -> Any:
        added = model.predict(observations, deterministic=True)[0]
        return task.scenario.swarm.v_max * (task.towards_guide(observations) + added)

    return velocities


def guided(task: Task) -> Any:
    """What all of them begin with."""
    return lambda observations: task.scenario.swarm.v_max * task.towards_guide(observations)


LEARNERS: dict[str, Callable[[Task], Any]] = {
    "sb3": sb3,
    "torchrl": torchrl,
    "written-out": written_out,
    "guided": guided,
}


def trained(learner: str, task: Task) -> csw.Policy:
    """The policy of a learner after a training."""
    torch.set_num_threads(1)
    torch.manual_seed(task.seed)
    model, name = LEARNERS[learner](task), f"{learner}, seed {task.seed}"
    return csw.as_policy(model, task.scenario, name=name, observed_guide=task.guide)


def sb3_policy(scenario: Scenario, guide: Guide) -> csw.Policy:
    """The policy of an entry of the leaderboard."""
    return trained("sb3", Task(scenario, guide, 0, STEPS))


def row(learner: str, task: Task) -> dict[str, Any]:
    """A row of the table."""
    scenario, started = task.scenario, time.process_time()
    policy = trained(learner, task)
    seconds = time.process_time() - started
    found = success_of(scenario, policy, task.guide)
    named = {"scenario": scenario.name, "learner": learner, "seed": task.seed}
    return {**named, **found, "seconds": round(seconds, 1)}


def main() -> None:
    """Train, and print the rows; of all, write the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    choices = [*SCENARIOS, *LEARNERS]
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(choices))
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--steps", type=int, default=STEPS)
    options = parser.parse_args()
    if unknown := set(options.parts) - set(choices):
        parser.error(f"unknown part {', '.join(sorted(unknown))}; parts: {', '.join(choices)}")
    names = [name for name in SCENARIOS if name in options.parts] or SCENARIOS
    learners = [name for name in LEARNERS if name in options.parts] or list(LEARNERS)
    rows = []
    for name in names:
        scenario = csw.load_scenario(name)
        guide = csw.plan(scenario)
        for learner in learners:
            for seed in range(1 if learner == "guided" else options.seeds):
                rows.append(row(learner, Task(scenario, guide, seed, options.steps)))
                print(*rows[-1].values(), flush=True)
    if not options.parts and (options.seeds, options.steps) == (SEEDS, STEPS):
        pd.DataFrame(rows).to_csv(TABLE, index=False)


if __name__ == "__main__":
    main()
