"""Commands in processes of their own."""

import json
import os
import re
import select
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

CASSWARM = Path(sys.executable).parent / "casswarm"
PNG = b"\x89PNG\r\n\x1a\n"  # first bytes of a PNG file
SIMULATION = ("simulate", "paper-1", "--runs", 40, "--seed", 5)
SMALL_SIMULATION = ("simulate", "single-agent", "--runs", 5, "--policy", "naive")

_TIMEOUT, _PROGRAM_TIMEOUT = 300, 900  # seconds


def casswarm(folder, *arguments, code=0, failing=()):
    """Run a command in a folder, check its exit code, and return what it printed.

    Its process is forked from one that has imported casswarm. `failing` are the place and the error
    of `failing_ending.fail`, which it calls first.
    """
    with tempfile.TemporaryDirectory() as place:
        output, error = Path(place) / "output", Path(place) / "error"
        request = {
            "folder": str(folder),
            "environment": dict(os.environ),
            "arguments": list(map(str, arguments)),
            "failing": failing,
            "input": os.devnull,
            "output": str(output),
            "error": str(error),
        }
        returned = _answer(json.dumps(request))
        done = subprocess.CompletedProcess(
            arguments, returned, output.read_text(), error.read_text()
        )
    return _checked(done, code)


def casswarm_program(folder, *arguments, code=0):
    """The same by the installed program, in a process that has imported nothing."""
    done = _program(CASSWARM, *arguments, folder=folder, PYTHONWARNINGS="error")
    return _checked(done, code)


def python(*arguments, folder=None, code=0, timeout=_PROGRAM_TIMEOUT, **environment):
    """Run Python, with warnings as errors, and check its exit code; any will do if it is None."""
    command = sys.executable, "-W", "error", *arguments
    done = _program(*command, folder=folder, timeout=timeout, **environment)
    assert code is None or done.returncode == code, f"{done.stdout}\n{done.stderr}"
    return done


def contents(folder):
    """Content of every file below a folder, and its folders."""
    return {path: path.is_file() and path.read_bytes() for path in folder.rglob("*")}


def with_hazard(text, lines):
    """Text of a scenario whose section of the hazard has these lines."""
    return re.sub(r"\[hazard\].*?\[guide\]", f"[hazard]\n{lines}\n\n[guide]", text, flags=re.DOTALL)


def _program(*command, folder, timeout=_TIMEOUT, **environment):
    return subprocess.run(
        list(map(str, command)),
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=timeout,
        env=os.environ | environment,
        check=False,
    )


def _checked(done, code):
    assert done.returncode == code, f"{done.stdout}\n{done.stderr}"
    assert "Traceback" not in done.stderr, done.stderr
    return done


def _answer(request):
    """Exit code of the command that the server runs."""
    server = _server()
    server.stdin.write(f"{request}\n")
    server.stdin.flush()
    if not select.select([server.stdout], [], [], _TIMEOUT)[0]:
        server.kill()
        _server.cache_clear()
        raise TimeoutError(f"no end after {_TIMEOUT} s: {request}")
    return int(server.stdout.readline())


@cache
def _server():
    """The process that forks; it ends with this one, which closes its standard input."""
    return subprocess.Popen(
        [sys.executable, "-W", "error", Path(__file__).with_name("fork_server.py")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
