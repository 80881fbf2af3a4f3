"""HTML, Markdown and JSON text: templates, tables, embedded images."""

from __future__ import annotations

import base64
import io
import json
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_NUMBER = re.compile(r"[-+−]?[\d.,]+(e[+-]?\d+)?( %| to [-+−]?[\d.,]+)?$")


def render(template: str, **values: Any) -> str:
    """Render a template of `casswarm/_util/templates`; text is escaped in HTML templates."""
    from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

    environment = Environment(
        loader=PackageLoader("casswarm", "_util/templates"),
        autoescape=select_autoescape(["html"]),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"html_table": html_table, "markdown_table": markdown_table}
    return environment.get_template(template).render(**values)


def html_table(table: pd.DataFrame) -> Any:
    """HTML of a table, marked as safe for templates; cells with numbers have the class ``n``."""
    from markupsafe import Markup

    numeric = _numeric(table)
    rows = [list(map(str, table.columns)), *table.astype(str).to_numpy().tolist()]
    return Markup(render("table.html", rows=rows, numeric=numeric))


def markdown_table(table: pd.DataFrame) -> str:
    """Markdown of a table; columns of numbers, also as text, are aligned to the right."""
    cells = table.astype(str).to_numpy().tolist()
    rule = ["--:" if numeric else ":--" for numeric in _numeric(table)]
    return "\n".join(
        f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |"
        for row in (map(str, table.columns), rule, *cells)
    )


def _numeric(table: pd.DataFrame) -> list[bool]:
    """Test each column for numbers, also as text; empty cells do not count."""
    columns = (map(str, table.iloc[:, k]) for k in range(table.shape[1]))
    return [all(not cell or _NUMBER.match(cell) for cell in column) for column in columns]


def data_uri(data: bytes, media_type: str) -> str:
    """Address that contains the data itself, such as an image within an HTML page."""
    return f"data:{media_type};base64,{base64.b64encode(data).decode()}"


def figure_bytes(figure: Figure, suffix: str = "png", **options: Any) -> bytes:
    """Content of a file with a drawn figure; options as for `Figure.savefig`."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format=suffix, **options)
    return buffer.getvalue()


def figure_uri(figure: Figure, suffix: str = "png", **options: Any) -> str:
    """Address that contains a drawn figure, PNG or SVG; options as for `Figure.savefig`."""
    media_type = {"png": "image/png", "svg": "image/svg+xml"}[suffix]
    return data_uri(figure_bytes(figure, suffix, **options), media_type)


def json_text(content: Any) -> str:
    """JSON text of plain values; numbers that JSON lacks (infinity, NaN) become null."""
    from pydantic_core import to_jsonable_python

    def fallback(value: Any) -> Any:
        if isinstance(value, Mapping):  # that is no dict
            return {str(key): part for key, part in value.items()}
        return value.tolist() if hasattr(value, "tolist") else str(value)

    plain = to_jsonable_python(content, inf_nan_mode="null", fallback=fallback)
    return json.dumps(plain, indent=2, allow_nan=False)
