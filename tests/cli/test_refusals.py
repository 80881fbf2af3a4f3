"""Wrong input is refused before any work, in one line that says what to do: exit code 2."""

from __future__ import annotations

import shlex

import casadi as ca
import pytest
from commands import casswarm, contents, with_hazard

import casswarm as csw

PAIR = "--set swarm.positions='[[0.0, 0.0], [0.4, 0.1]]' --set time.t_f=8.0"
NAN = "Invalid value for '{}': nan is not a finite number."
INFINITE = "inf is not a finite number."
REFUSED = [
    ("plan papr-1", "did you mean 'paper-1'"),
    ("plan paper-1 --set swarm.vmax=1", "swarm.v_max"),
    ("plan paper-1 --set formation.rho", "KEY=VALUE"),
    ("plan paper-1 --set time.dt=-1", "time.dt"),
    ("plan paper-1 --solver ipop", "did you mean 'ipopt'"),
    ("plan paper-1 --search everywhere", "everywhere"),
    ("plan paper-1 --set target.center='[80.0, 65.0]'", "reach"),
    ("plan paper-1 --joint", "--joint"),
    ("plan", "SCENARIO"),
    ("fly paper-1", "No such command"),
    ("simulate paper-1 --policy leeder", "did you mean 'leader'"),
    ("simulate paper-1 --policy leader --policy leader", "repeated"),
    ("simulate paper-1 --policy nowhere:policy", "cannot import the module"),
    ("simulate paper-1 --runs 0", "0"),
    ("simulate paper-1 --runs 9 --half-width 0.1", "give one of them"),
    (f"simulate paper-1 --seed {2**64}", "0<=x<=18446744073709551615"),
    ("simulate paper-1 --solver newton", "projected-gradient"),
    ("evaluate paper-1 --tolerance 1", "--tolerance"),
    ("evaluate large-swarm --tolerance 0", "give a larger tolerance"),
    ("sweep paper-1", "nothing to sweep"),
    ("sweep paper-1 --set rho", "KEY=V1,V2"),
    ("sweep paper-1 --set formation.rho=0:1", "START:STOP:COUNT"),
    ("sweep paper-1 --set formation.rho=0:1:3:log", "above 0 for log"),
    (
        "sweep paper-1 --set n=1:3:6",
        "n takes whole numbers, not 1.4; choose a COUNT that gives whole numbers, such as n=1:3:3, "
        "or list the numbers, n=V1,V2,...",
    ),
    ("sweep paper-1 --set n=1:7:5", "such as n=1:7:4,"),
    ("sweep paper-1 --set n=0.5:3:2", "n takes whole numbers, not 0.5"),
    ("sweep paper-1 --set guide.iterations=1:2:3", "guide.iterations takes whole numbers, not 1.5"),
    ("sweep paper-1 --set formation.rho=inf:1:3", "START and STOP are finite numbers"),
    ("sweep paper-1 --set formation.rho=0.1:nan:3", "START and STOP are finite numbers"),
    (
        "sweep paper-1 --set formation.rho=0.1:0.2:1000000000000",
        "COUNT is a whole number from 1 to 1000",
    ),
    ("sweep paper-1 --set n=1 --exact --runs 2", "give one of them"),
    ("sweep paper-1 --set n=1,2 --exact --runs 5", "give one of them"),
    ("sweep paper-1 --set n=1,2 --policy no_such:policy", "cannot import the module"),
    ("scenarios show nowhere.toml", "nowhere.toml"),
    # files
    ("plot nowhere", "is not a folder: expected one written by casswarm plan"),
    ("animate files", "expected one written by casswarm simulate, such as results/sim"),
    ("animate planned", "casswarm plan, which saves no trajectories"),
    ("explore nowhere --no-browser", "no scenario 'nowhere'"),
    ("explore paper-1 --no-browser --out kept.toml", "kept.toml exists"),
    ("scenarios new kept.toml", "--force"),
    ("scenarios check rates.toml --allow-code", "SystemExit: sys.exit(0) (rates.py:4)"),
    ("compare none.toml", "none.toml"),
    ("compare --problems none.nl", "none.nl: No such file or directory"),
    ("explain none.nl", "none.nl: No such file or directory"),
    ("compare --problems files/cut.nl", "files/cut.nl, line 2: the file ends too early"),
    ("compare --family quick --against nowhere", "nowhere holds no comparison"),
    (
        "compare --family quick --against nowhere --out files/one.nl/results",
        "nowhere holds no comparison",
    ),
    # code of one's own
    ("compare --solver my_module:number", "'my_module:number' is not derived from"),
    ("compare --solver my_module:none", "has no function 'none'"),
    ("compare --solver nothing:Mine", "cannot import the module 'nothing'"),
    (
        "simulate single-agent --policy quits:policy",
        "cannot import the module 'quits' of 'quits:policy': SystemExit: sys.exit(0) (quits.py:2)",
    ),
    (
        "simulate single-agent --policy my_module:odd --runs 2",
        "'a$x_{$': figures and files need printable characters",
    ),
    ("simulate single-agent --policy my_module:long --runs 2", "xxx...: figures and files need"),
    # misspelt names
    ("compare --family guide", "did you mean 'guides'?"),
    ("compare --solver ipop", "did you mean 'ipopt'?"),
    ("explore paper-1 --no-browser --policy leadr", "did you mean 'leader'"),
    ("reproduce --only table-3", "'table-3' is unknown; did you mean 'table-2'? (known: table-1, "),
    *(
        (f"{command} {option}", message)
        for command in (
            "simulate single-agent",
            "evaluate single-agent",
            "sweep single-agent --set formation.rho=0.1,0.2",
        )
        for option, message in (
            ("--policy leeder", "policy 'leeder' is unknown; did you mean 'leader'"),
            ("--solver spectrall", "solver 'spectrall' is unknown; did you mean 'spectral'"),
        )
    ),
    # numbers out of range
    ("compare --time-limit 0", "--time-limit"),
    ("compare --copies -1", "--copies"),
    ("explore paper-1 --no-browser --set swarm.v_max=-1", "swarm.v_max"),
    ("evaluate single-agent --aggregation-tol 1", "aggregation_tol = 1; allowed: 0, or from"),
    (
        f"plan-swarm paper-1 {PAIR} --min-distance 2",
        "members start 0.412311 apart; choose a smaller distance",
    ),
    # numbers that are none
    ("plan single-agent --gap nan", NAN.format("--gap")),
    ("plan single-agent --time-limit nan", NAN.format("--time-limit")),
    ("plan-swarm single-agent --min-distance nan", NAN.format("--min-distance")),
    ("plan-swarm single-agent --time-limit nan", NAN.format("--time-limit")),
    ("simulate single-agent --half-width nan", NAN.format("--half-width")),
    ("simulate single-agent --policy-time-limit nan", NAN.format("--policy-time-limit")),
    ("evaluate single-agent --tolerance nan", NAN.format("--tolerance")),
    ("evaluate single-agent --aggregation-tol nan", NAN.format("--aggregation-tol")),
    ("sweep single-agent --tolerance nan", NAN.format("--tolerance")),
    ("animate single-agent --fps nan", NAN.format("--fps")),
    ("plan-swarm single-agent --min-distance inf", INFINITE),
    ("evaluate single-agent --aggregation-tol inf", INFINITE),
    ("simulate single-agent --policy-time-limit inf", INFINITE),
    ("simulate single-agent --resume --overwrite", "--resume and --overwrite: give one of them"),
    ("sweep single-agent --resume --overwrite", "--resume and --overwrite: give one of them"),
    # options without effect
    ("plan paper-1 --solver projected-gradient --search global", "do not apply"),
    (
        "compare --problems files --count 2",
        "--count does not apply: all problems are those",
    ),
    ("compare --policy leader", "--policy does not apply: no scenario is given"),
    ("compare --allow-code", "--allow-code does not apply: no scenario is given"),
    (
        "plan single-agent --no-certify --gap 0.1",
        "Error: --gap does not apply: no bound is computed",
    ),
    ("plan single-agent --verbose --quiet", "Error: --quiet does not apply"),
    ("plan single-agent --no-figures --dpi 100", "Error: --dpi does not apply: nothing is drawn"),
    (
        "evaluate single-agent --seed 3",
        "Error: --seed does not apply: nothing is sampled without --runs",
    ),
    ("sweep single-agent --set n=1,2 --seed 0", "Error: --seed does not apply"),
    (
        "sweep single-agent --set n=1,2 --runs 3 --tolerance 0.1 --max-states 9",
        "Error: --tolerance, --max-states do not apply: nothing is enumerated with --runs",
    ),
    (
        "simulate single-agent --policy-time-limit 3",
        "Error: --policy-time-limit does not apply: no policy is your own",
    ),
    (
        "simulate single-agent --solver projected-gradient --arrival any",
        "Error: --arrival does not apply: projected-gradient starts from the straight line",
    ),
    (
        "simulate single-agent --report --no-figures",
        "Error: --report and --no-figures: give one of them",
    ),
    (
        "simulate single-agent --dask tcp://127.0.0.1:9 --workers 2",
        "Error: --workers does not apply",
    ),
    (
        "reproduce --only figures --no-figures",
        "--only figures and --no-figures: give one of them",
    ),
    (f"plan-swarm paper-1 {PAIR} --gap 0.1", "No such option"),
    (f"plan-swarm paper-1 {PAIR} --objective arrival", "arrivals"),
]


PLANNED_FIRST = (
    "evaluate single-agent --aggregation-tol 1",
    f"plan-swarm paper-1 {PAIR} --min-distance 2",
)
MODULE = """
from casswarm import as_policy

number = 3
odd = as_policy(lambda *_: 0, name="a$x_{$")
long = as_policy(lambda *_: 0, name="x" * 100_000)
"""
RATES = """
import sys
def leaving(positions, alive):
    sys.exit(0)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Files that commands are given."""
    folder = tmp_path_factory.mktemp("given")
    (folder / "my_module.py").write_text(MODULE)
    (folder / "quits.py").write_text("import sys\nsys.exit(0)\n")
    (folder / "rates.py").write_text(RATES)
    scenario = csw.load_scenario("single-agent")
    (folder / "rates.toml").write_text(with_hazard(scenario.to_toml(), 'kind = "rates:leaving"'))
    (folder / "kept.toml").write_text("kept")
    (folder / "planned").mkdir()
    (folder / "planned" / "run.json").write_text('{"command": "plan"}')
    (folder / "files").mkdir()
    (folder / "files" / "cut.nl").write_text("g3 1 1 0\n 2 0 1\n")
    x = ca.SX.sym("x", 2)
    csw.Problem.from_casadi({"x": x, "f": ca.sumsqr(x - 1)}, "one").to_nl(folder / "files/one.nl")
    return folder


@pytest.mark.parametrize(("line", "message"), REFUSED, ids=[line for line, _ in REFUSED])
def test_wrong_input_is_explained_with_exit_code_2(folder, line, message):
    before = contents(folder)
    done = casswarm(folder, *shlex.split(line), code=2)
    assert message in done.stderr
    assert ("optimising" in done.stderr) == (line in PLANNED_FIRST)
    assert not done.stdout
    assert contents(folder) == before
