"""Links that lead out of docs/, which hold where the repository is read, made to hold on the site.

The README becomes the site's first page, the changelog and the notebooks their pages here, and
links to folders plain text. Other files are copied, to be downloaded.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

LINK = re.compile(r"\[([^\]]*)\]\((\.\.?/[^)#\s]+)(#[^)\s]*)?\)")
PAGES = {"README.md": "/index.md", "CHANGELOG.md": "/changelog.md"}


def rewritten(app: Sphinx, docname: str, source: list[str]) -> None:
    """Rewrite the links of a page of Markdown."""
    docs = Path(app.srcdir).resolve()
    page = Path(app.env.doc2path(docname))
    if page.suffix != ".md":
        return

    def replaced(link: re.Match[str]) -> str:
        target = (page.parent / link[2]).resolve()
        if target.is_relative_to(docs) or not target.is_relative_to(docs.parent):
            return link[0]
        inside = target.relative_to(docs.parent)
        if target.is_dir():
            return link[1]
        if inside.parent.name == "notebooks" and target.suffix == ".py":
            return f"[{link[1]}](/notebooks/{target.stem}.ipynb)"
        place = PAGES.get(str(inside))
        return f"[{link[1]}]({place})" if place else link[0]

    source[0] = LINK.sub(replaced, source[0])


def setup(app: Sphinx) -> dict[str, Any]:
    """When a page is read."""
    app.connect("source-read", rewritten)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
