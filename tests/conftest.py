"""Settings of all tests: hypothesis' examples, and Ctrl-C; the commands that are run once.

The README's test command is deterministic: hypothesis draws the same examples every time. Fresh
ones are drawn by ``pytest -m "slow or hypothesis" --hypothesis-profile=fresh``, as in ``.ci/run``.
"""

import signal
from functools import cache

import pytest
from commands import casswarm
from hypothesis import settings

settings.register_profile("deterministic", deadline=None, derandomize=True)
settings.register_profile("fresh", deadline=None, print_blob=True)
settings.load_profile("deterministic")

# a shell that starts the tests in the background has them, and their children, ignore SIGINT
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """Results folder of a command that is run once in a session, and what it printed."""

    @cache
    def run(*arguments):
        folder = tmp_path_factory.mktemp(arguments[0])
        done = casswarm(folder, *arguments)
        (results,) = (folder / "results").iterdir()
        return results, done

    return run
