"""``{pages}``: a toctree with patterns, of which one that fits no page is no error."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.directives.other import TocTree
from sphinx.util.matching import patfilter


class Pages(TocTree):
    """A toctree of the pages that there are."""

    def run(self) -> list[nodes.Node]:
        """The toctree, without patterns that fit nothing."""
        self.options["glob"] = None
        names = self.env.found_docs
        kept = [line for line in self.content if "*" not in line or any(patfilter(names, line))]
        self.content = StringList(kept, source=str(self.env.doc2path(self.env.docname)))
        return super().run()


def setup(app: Sphinx) -> dict[str, Any]:
    """The directive."""
    app.add_directive("pages", Pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
