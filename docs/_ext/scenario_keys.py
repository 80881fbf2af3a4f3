"""Reference of scenario files, generated from the pydantic schema that validates them.

``{scenario-keys}`` makes a section a table of the file, with every key's limits, default and
meaning; ``{builtin-scenarios}`` a table of the scenarios that come with casswarm.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from docutils import nodes
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from casswarm.scenario import Scenario, builtin_scenarios, load_scenario
from casswarm.scenario.cases import radars_text
from casswarm.scenario.hazard_table import CONSTANTS
from casswarm.scenario.validation import allowed, element_table, fields, has_names, subtable

HEAD = ("Key", "Allowed", "Default", "Meaning")


def tables() -> Iterator[tuple[str, type[BaseModel]]]:
    """The tables of a file by name, in its order; the keys above all tables are named ''."""
    yield "", Scenario
    for key, field in fields(Scenario).items():
        model = subtable(field)
        if model is not None:
            yield key, model
            for name, inner in fields(model).items():
                element = element_table(inner)
                if element is not None:
                    named = has_names(inner)
                    yield (f"{key}.{name}.NAME" if named else f"[{key}.{name}]"), element


def rows(table: str, model: type[BaseModel]) -> list[tuple[str, str, str, str]]:
    """Key, limits, default and meaning of every key of a table, as Markdown."""
    return [
        (f"`{key}`", marked(allowed(field)), default(table, key, field), marked(meaning(field)))
        for key, field in fields(model).items()
        if subtable(field) is None
    ]


def meaning(field: FieldInfo) -> str:
    """Description of a key, with its unit."""
    if not field.description:
        raise ValueError(f"a field of the schema has no description: {field}")
    return field.description


def default(table: str, key: str, field: FieldInfo) -> str:
    """Default of a key as it would be written, or the kinds of hazard that require it."""
    if field.is_required():
        return "required"
    kinds = [k for k, required in CONSTANTS.items() if table == "hazard" and key in required]
    if kinds:
        every = len(kinds) == len(CONSTANTS)
        requiring = "every built-in kind" if every else " and ".join(f'`"{k}"`' for k in kinds)
        return f"required by {requiring}"
    value = field.get_default(call_default_factory=True)
    if value is None or value in ({}, ()):
        return "none"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return f'`"{value}"`' if isinstance(value, str) else f"`{value:g}`"


def marked(text: str) -> str:
    """Plain text as Markdown, with quoted words as code."""
    escaped = re.sub(r"([\\*_\[\]$<>`|])", r"\\\1", text)
    return re.sub(
        r"'([\w:+\\-]+)'", lambda word: '`"{}"`'.format(word[1].replace("\\", "")), escaped
    )


def list_table(head: Sequence[str], lines: Iterable[Sequence[str]], widths: str) -> str:
    """A table as MyST Markdown."""
    cells = [
        f"{'* -' if column == 0 else '  -'} {cell}"
        for line in [head, *lines]
        for column, cell in enumerate(line)
    ]
    options = [":header-rows: 1", f":widths: {widths}", ":class: reference"]
    return "\n".join(["```{list-table}", *options, "", *cells, "```", ""])


def reference() -> str:
    """Sections of all tables."""
    parts = []
    for name, model in tables():
        text = "Keys that precede all tables."
        if name:
            text = (model.__doc__ or "").split("\n\n")[0]
            optional = name not in fields(Scenario) or not fields(Scenario)[name].is_required()
            text += " The table is optional." if optional else ""
        title = f"`[{name}]`" if name else "Name and description"
        parts += [f"## {title}", "", text, "", list_table(HEAD, rows(name, model), "14 24 16 46")]
    return "\n".join(parts)


def builtin() -> str:
    """Table of the built-in scenarios."""
    lines = []
    for name, description in builtin_scenarios().items():
        scenario = load_scenario(name)
        radars = radars_text(scenario.hazard_table).replace(" radars", "").replace(" radar", "")
        numbers = (str(scenario.n), radars, str(scenario.n_steps))
        lines.append((f"`{name}`", *numbers, marked(description)))
    return list_table(("Name", "Members", "Radars", "Steps", "Description"), lines, "16 9 9 9 57")


class ScenarioKeys(SphinxDirective):
    """``{scenario-keys}``."""

    def run(self) -> list[nodes.Node]:
        """Sections of the reference."""
        return self.parse_text_to_nodes(reference(), allow_section_headings=True)


class BuiltinScenarios(SphinxDirective):
    """``{builtin-scenarios}``."""

    def run(self) -> list[nodes.Node]:
        """Table of scenarios."""
        return self.parse_text_to_nodes(builtin())


def setup(app: Sphinx) -> dict[str, Any]:
    """Register both directives."""
    app.add_directive("scenario-keys", ScenarioKeys)
    app.add_directive("builtin-scenarios", BuiltinScenarios)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
