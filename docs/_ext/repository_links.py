"""Relative links that lead out of docs/, which work on GitHub, made to work on the site.

The README becomes the front page, the changelog and the notebooks their pages here; any other file
is linked on GitHub.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

LINK = re.compile(r"\[([^\]]*)\]\((\.\.?/[^)#\s]+)(#[^)\s]*)?\)")
PAGES = {"README.md": "/index.md", "CHANGELOG.md": "/changelog.md"}
GITHUB = "https://github.com/casswarm/casswarm/blob/main/"


def rewrite_links(app: Sphinx, docname: str, source: list[str]) -> None:
    """Rewrite the links of a Markdown page."""
    docs = Path(app.srcdir).resolve()
    page = Path(app.env.doc2path(docname))
    if page.suffix != ".md":
        return

    def rewritten(link: re.Match[str]) -> str:
        target = (page.parent / link[2]).resolve()
        if target.is_relative_to(docs) or not target.is_relative_to(docs.parent):
            return link[0]
        path = target.relative_to(docs.parent).as_posix()
        notebook = path.startswith("notebooks/")
        return f"[{link[1]}]({f'/{path}' if notebook else PAGES.get(path, GITHUB + path)})"

    source[0] = LINK.sub(rewritten, source[0])


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect to the reading of pages."""
    app.connect("source-read", rewrite_links)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
