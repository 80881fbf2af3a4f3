"""For all tests: machines are shared, so no example has a deadline; and Ctrl-C is heard.

A shell that starts the tests in the background has them, and all their children, ignore SIGINT.
"""

import signal

from hypothesis import settings

settings.register_profile("casswarm", deadline=None)
settings.load_profile("casswarm")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
