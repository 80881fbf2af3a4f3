"""Templates of the pages that casswarm writes, rendered by Jinja."""

from __future__ import annotations

from typing import Any


def rendered(template: str, **values: Any) -> str:
    """The template of a name with these values, which are escaped where they are texts."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("casswarm", "_util/templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(**values)
