"""Files of figures."""

from __future__ import annotations

from pathlib import Path

from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure


def save(fig: Figure, path: Path | str, dpi: int = 200) -> Path:
    """Write a figure at its own width, in the format of the file's suffix (png, pdf, svg, ...).

    The same figure gives the same file, byte for byte: no dates are written.
    """
    path = Path(path)
    if path.suffix.lower() == ".png":
        _save_png(fig, path, dpi)
        return path
    date = {".pdf": "CreationDate", ".svg": "Date"}.get(path.suffix.lower())
    # text as text, which journals ask for; identifiers in an SVG that do not change
    with rc_context({"pdf.fonttype": 42, "svg.hashsalt": "casswarm"}):
        fig.savefig(path, dpi=dpi, metadata={date: None} if date else None)
    return path


def _save_png(fig: Figure, path: Path, dpi: int) -> None:
    """Draw a figure once; `Figure.savefig` draws it twice, for options that are not used here."""
    own = fig.dpi
    fig.set_dpi(dpi)
    try:
        FigureCanvasAgg(fig).print_png(path)  # type: ignore[no-untyped-call]
    finally:
        fig.set_dpi(own)
