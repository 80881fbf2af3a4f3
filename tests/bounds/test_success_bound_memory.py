"""The memory of `success_bound` is bounded, wherever the members are."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("resource")

CODE = """
import resource
import sys
from pathlib import Path

import casswarm as csw

scenario = csw.load_scenario("paper-1")
far = float(sys.argv[1])
values = {"swarm.positions": [[far, 0.0], *map(list, scenario.positions[1:])]}
if sys.argv[2] == "reachable":
    values |= {"target.center": [far / 2, 0.0], "target.radius": far / 2 - 10.0}
    values |= {"hazard.core_radius": 0.01}
scenario = scenario.with_values(values)
pages = int(Path("/proc/self/statm").read_text().split()[0])
limit = pages * resource.getpagesize() + 600_000_000
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
print(*csw.success_bound(scenario).risks)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="limits memory as on Linux")
@pytest.mark.parametrize(
    "far", ["1500", *(pytest.param(far, marks=pytest.mark.slow) for far in ("1e8", "2e9"))]
)
@pytest.mark.parametrize("kind", ["reachable", "unreachable"])
def test_far_members_need_no_more_memory(far, kind):
    done = subprocess.run(
        [sys.executable, "-c", CODE, far, kind], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    risks = np.array(done.stdout.split(), float)
    assert (risks[0] == np.inf) == (kind == "unreachable")
    assert (risks[1:] >= 0).all()
    assert np.isfinite(risks[1:]).all()
