"""Plan, evaluate and simulate in eight threads: `python eight_threads.py REPEATS SECONDS`.

Fails unless all threads find what a single one finds, and ends itself after that many seconds.
"""

import faulthandler
import sys
import threading

import numpy as np
from sweep_cases import SMALL

import casswarm as csw

THREADS = 8
STATES = np.linspace(0.0, 5.0, 40).reshape(10, 2, 2)


def rate(positions, alive, radars, strength):
    east, north = radars[0]
    return strength * alive / (1 + (positions[:, 0] - east) ** 2 + (positions[:, 1] - north) ** 2)


def results(number):
    """Some of everything; the rates are those of few threads, so that each builds and shares."""
    strength = 5.0 + number % 3
    scenario = SMALL.with_values({"hazard.alpha_1": strength})
    hazard = csw.CustomHazard(rate, radars=[(3.0, 2.0)], parameters={"strength": strength})
    guide = csw.plan(scenario, search="local", certify=False)
    policy = csw.make_policy("constrained", scenario, guide, "ipopt")
    return (
        guide.risk,
        csw.evaluate(scenario, "leader", 0.2, max_states=30, guide=guide).success,
        csw.evaluate(scenario, policy, 0.2, max_states=20, guide=guide).success,
        csw.simulate(scenario, ["leader"], runs=10, guide=guide).runs["steps"].tolist(),
        csw.success_bound(scenario, max_nodes=20_000).value,
        hazard.rates(STATES).tolist(),
    )


def main():
    repeats, seconds = map(int, sys.argv[1:])
    faulthandler.dump_traceback_later(seconds, exit=True)
    found = {}

    def work(number):
        found[number] = [results(number) for _ in range(repeats)]

    threads = [threading.Thread(target=work, args=(number,)) for number in range(THREADS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for number in range(THREADS):
        assert found[number] == [results(number)] * repeats, number


if __name__ == "__main__":
    main()
