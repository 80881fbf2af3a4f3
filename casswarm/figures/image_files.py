"""Files and themes of figures, and the charts that belong to `casswarm.comparison`."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from .._util.figure_style import THEMES, theme
from ..comparison.charts import (
    band_chart,
    gap_chart,
    pair_chart,
    profile_chart,
    ranking_chart,
    win_chart,
)

__all__ = [
    "THEMES",
    "band_chart",
    "file_content",
    "gap_chart",
    "pair_chart",
    "profile_chart",
    "ranking_chart",
    "save",
    "theme",
    "win_chart",
]

_DATES = {"pdf": "CreationDate", "svg": "Date"}


def save(fig: Figure, path: Path | str, dpi: int = 200) -> Path:
    """Write a figure at its own width, in the format of the file's suffix (png, pdf, svg, ...).

    The same figure gives the same file, byte for byte: no dates are written.
    """
    path = Path(path)
    path.write_bytes(file_content(fig, path.suffix[1:].lower(), dpi))
    return path


def file_content(fig: Figure, suffix: str, dpi: int = 200) -> bytes:
    """Content of the file that `save` writes, in the format of a suffix without its dot."""
    buffer = BytesIO()
    if suffix == "png":
        _save_png(fig, buffer, dpi)
        return buffer.getvalue()
    date = _DATES.get(suffix)
    # text as text, which journals ask for; identifiers in an SVG that do not change
    with rc_context({"pdf.fonttype": 42, "svg.hashsalt": "casswarm"}):
        fig.savefig(buffer, format=suffix or None, dpi=dpi, metadata={date: None} if date else None)
    return buffer.getvalue()


def _save_png(fig: Figure, buffer: BytesIO, dpi: int) -> None:
    """Draw a figure once; `Figure.savefig` draws it twice, for options that are not used here."""
    own = fig.dpi
    fig.set_dpi(dpi)
    try:
        FigureCanvasAgg(fig).print_png(buffer)  # type: ignore[no-untyped-call]
    finally:
        fig.set_dpi(own)
