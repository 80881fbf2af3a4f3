"""The site: its pages' examples run, its links lead somewhere, its references miss nothing."""

from __future__ import annotations

from pathlib import Path

import pytest
from doc_blocks import blocks, run

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
PAGES = sorted(page for page in DOCS.rglob("*.md") if "_build" not in page.parts)


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p)], ids=lambda page: page.stem)
def test_marked_examples_of_a_page_run(page: Path, tmp_path: Path) -> None:
    run(page, tmp_path)
