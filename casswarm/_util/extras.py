"""Optional packages: an error that names the extra where one is missing."""

from __future__ import annotations

from importlib.util import find_spec

from ..errors import ExtraError


def require_extra(extra: str, package: str) -> None:
    """Raise ExtraError if an optional package is not installed."""
    if find_spec(package) is None:
        raise ExtraError(
            f"the package {package} is not installed: pip install 'casswarm[{extra}]'",
            package=package,
            extra=extra,
        )
