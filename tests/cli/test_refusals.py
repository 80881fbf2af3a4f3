"""Wrong input is refused before any work, in one line that says what to do: exit code 2."""

from __future__ import annotations

import shlex

import pytest
from click.testing import CliRunner

from casswarm.cli import main

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
    ("sweep paper-1 --set n=1 --exact --runs 2", "give one of them"),
    ("sweep paper-1 --set n=1,2 --exact --runs 5", "give one of them"),
    ("sweep paper-1 --set n=1,2 --policy no_such:policy", "cannot import the module"),
    ("scenarios show nowhere.toml", "nowhere.toml"),
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


@pytest.mark.parametrize(("line", "message"), REFUSED, ids=[line for line, _ in REFUSED])
def test_wrong_input_is_explained_with_exit_code_2(tmp_path, monkeypatch, line, message):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(main, shlex.split(line))
    assert done.exit_code == 2
    assert message in done.stderr
    assert not done.stdout
    assert not list(tmp_path.iterdir())
