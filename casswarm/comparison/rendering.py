"""A report as Markdown, with its figures beside it, and as one HTML file that holds them."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

import pandas as pd
from matplotlib.figure import Figure


@dataclass(frozen=True)
class Heading:
    """A heading; `level` is 1 for the title."""

    text: str
    level: int = 2


@dataclass(frozen=True)
class Text:
    """A paragraph, plain."""

    text: str


@dataclass(frozen=True, eq=False)
class Table:
    """A table; columns of numbers, also as texts, are set to the right."""

    frame: pd.DataFrame

    def rows(self) -> list[list[str]]:
        """Names of the columns, and the cells, as texts."""
        cells = [[str(cell) for cell in row] for row in self.frame.itertuples(index=False)]
        return [list(map(str, self.frame.columns)), *cells]

    def numeric(self) -> list[bool]:
        """Which columns are of numbers."""
        _, *cells = self.rows()
        columns = zip(*cells, strict=True) if cells else [()] * len(self.frame.columns)
        return [all(not cell or _NUMBER.match(cell) for cell in column) for column in columns]


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure, the name of its file without the ending, and how to read it."""

    name: str
    figure: Figure
    caption: str


_NUMBER = re.compile(r"-?[\d.]+(e[+-]?\d+)?( %| to \d+)?$")

Block = Heading | Text | Table | Picture


def markdown(blocks: Sequence[Block], ending: str = "png") -> str:
    """Markdown text; pictures are links to files NAME.ENDING in its folder."""
    return "\n\n".join(_markdown(block, ending) for block in blocks) + "\n"


def html(blocks: Sequence[Block], images: Mapping[str, bytes] | None = None) -> str:
    """An HTML page that needs no other file; `images` are PNGs of figures, by name, if drawn."""
    images = images or {}
    title = next((b.text for b in blocks if isinstance(b, Heading)), "Report")
    body = "\n".join(_html(block, images) for block in blocks)
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n"
        f"{body}\n</body>\n</html>\n"
    )


_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; max-width: 62em; margin: 2em auto;
       padding: 0 1em; }
table { border-collapse: collapse; font-size: 85%; margin: 1em 0; }
th, td { padding: .25em .7em; text-align: left; border-bottom: 1px solid #ddd; }
.n { text-align: right; font-variant-numeric: tabular-nums; }
figure { margin: 1.5em 0; } figcaption { font-size: 90%; color: #444; } img { max-width: 100%; }
"""


def _markdown(block: Block, ending: str) -> str:
    match block:
        case Heading():
            return f"{'#' * block.level} {block.text}"
        case Text():
            return block.text
        case Picture():
            alt = " ".join(block.figure.get_suptitle().split()) or block.name
            return f"![{alt}]({block.name}.{ending})\n\n*{block.caption}*"
        case Table():
            head, *rows = block.rows()
            rule = ["--:" if numeric else ":--" for numeric in block.numeric()]
            return "\n".join(
                f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |"
                for row in (head, rule, *rows)
            )


def _html(block: Block, images: Mapping[str, bytes]) -> str:
    match block:
        case Heading():
            return f"<h{block.level}>{escape(block.text)}</h{block.level}>"
        case Text():
            return f"<p>{escape(block.text)}</p>"
        case Picture():
            data = base64.b64encode(images.get(block.name) or _png(block.figure)).decode()
            return (
                f'<figure><img alt="{escape(block.name)}" src="data:image/png;base64,{data}">'
                f"<figcaption>{escape(block.caption)}</figcaption></figure>"
            )
        case Table():
            head, *rows = block.rows()
            numeric = block.numeric()
            lines = [_html_row("th", head, numeric), *(_html_row("td", r, numeric) for r in rows)]
            return "<table>\n" + "\n".join(lines) + "\n</table>"


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=130, bbox_inches="tight")
    return buffer.getvalue()


def _html_row(tag: str, cells: Sequence[str], numeric: Sequence[bool]) -> str:
    written = (
        f"<{tag}{' class=n' if right else ''}>{escape(cell)}</{tag}>"
        for cell, right in zip(cells, numeric, strict=True)
    )
    return f"<tr>{''.join(written)}</tr>"
