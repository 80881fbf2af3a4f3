"""For all tests: machines are shared, so no example has a deadline."""

from hypothesis import settings

settings.register_profile("casswarm", deadline=None)
settings.load_profile("casswarm")
