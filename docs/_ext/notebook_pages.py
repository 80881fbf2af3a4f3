"""Notebooks as pages: the scripts in notebooks/ as .ipynb, where Sphinx looks for sources."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jupytext
from sphinx.application import Sphinx


def convert_notebooks(app: Sphinx, _config: object) -> None:
    """Bring docs/notebooks up to date; files that would not change are not written."""
    target = Path(app.srcdir) / "notebooks"
    target.mkdir(exist_ok=True)
    wanted = {
        f"{path.stem}.ipynb": as_ipynb(path)
        for path in (Path(app.confdir).parent / "notebooks").glob("*.py")
    }
    for path in target.glob("*.ipynb"):
        if path.name not in wanted:
            path.unlink()
    for name, text in wanted.items():
        path = target / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def as_ipynb(path: Path) -> str:
    """The notebook of a script in percent format, the same text for the same script."""
    notebook = jupytext.read(path, fmt="py:percent")
    for number, cell in enumerate(notebook.cells):
        cell["id"] = f"cell-{number}"  # else random
    return str(jupytext.writes(notebook, fmt="ipynb"))


def setup(app: Sphinx) -> dict[str, Any]:
    """Before sources are looked for."""
    app.connect("config-inited", convert_notebooks)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
