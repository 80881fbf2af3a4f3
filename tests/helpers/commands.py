"""Commands in processes of their own."""

import os
import subprocess
import sys
from pathlib import Path

CASSWARM = Path(sys.executable).parent / "casswarm"
PNG = b"\x89PNG\r\n\x1a\n"  # first bytes of a PNG file


def casswarm(folder, *arguments, code=0):
    """Run a command in a folder, check its exit code, and return what it printed."""
    done = subprocess.run(
        [CASSWARM, *map(str, arguments)],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
        env=os.environ | {"PYTHONWARNINGS": "error"},
        check=False,
    )
    assert done.returncode == code, f"{done.stdout}\n{done.stderr}"
    assert "Traceback" not in done.stderr, done.stderr
    return done
