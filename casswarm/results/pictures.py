"""Figures as data URIs, for pages that load nothing."""

from __future__ import annotations

import io

from matplotlib import rc_context
from matplotlib.figure import Figure

from .._util.documents import data_uri


def svg_uri(figure: Figure) -> str:
    """Data URI of a figure as SVG, reproducible; text as outlines, since fonts differ."""
    buffer = io.BytesIO()
    with rc_context({"svg.hashsalt": "casswarm", "svg.fonttype": "path"}):
        figure.savefig(buffer, format="svg", dpi=110, metadata={"Date": None})
    return data_uri(buffer.getvalue(), "image/svg+xml")


def png_uri(figure: Figure, dpi: int = 100) -> str:
    """Data URI of a figure as PNG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi)
    return data_uri(buffer.getvalue(), "image/png")
