"""Settings of all tests: hypothesis' examples, and Ctrl-C.

The README's test command is deterministic: hypothesis draws the same examples every time. Fresh
ones are drawn by ``pytest -m "slow or hypothesis" --hypothesis-profile=fresh``, as in ``.ci/run``.
"""

import signal

from hypothesis import settings

settings.register_profile("deterministic", deadline=None, derandomize=True)
settings.register_profile("fresh", deadline=None, print_blob=True)
settings.load_profile("deterministic")

# a shell that starts the tests in the background has them, and their children, ignore SIGINT
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
