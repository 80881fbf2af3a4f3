"""The files of ``static/``: the view, which the widget and the local page share, and that page."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

_SCRIPT = ("elements.js", "messages.js", "map.js", "controls.js", "results.js", "view.js")
"""Parts of ``explore.js``, a single module, because a widget cannot import another one."""

PAGE = ("page.html", "page.js", "page.css", "explore.js", "explore.css")
"""What the local page consists of."""


@cache
def static_text(name: str) -> str:
    """Text of a file of ``static/``, or of ``explore.js``, which consists of several."""
    folder = files(__package__).joinpath("static")
    parts = _SCRIPT if name == "explore.js" else (name,)
    return "\n".join(folder.joinpath(part).read_text(encoding="utf-8") for part in parts)
