"""The reference of public names, from their docstrings; it has every name of ``casswarm.__all__``.

``{public-names} SUBJECT`` documents the names whose modules belong to a subject: a table, then
name by name. Modules that no subject claims are the subject ``more``, so that nothing is left out.
"""

from __future__ import annotations

import inspect
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective, SphinxRole

import casswarm

SUBJECTS = {
    "scenarios": ("scenario",),
    "hazards": ("hazard",),
    "guides": ("planning", "guide", "certificate.refinement", "certificate.value"),
    "policies": ("policies",),
    "studies": ("study", "pilot", "sweeping"),
    "laws": ("evaluation", "chain.law", "chain.hybrid"),
    "solvers": ("solvers", "solution"),
    "comparison": ("comparison",),
    "errors": ("errors",),
}
"""Modules by subject, as `casswarm._HOME` names them."""


def names_of(subject: str) -> list[str]:
    """Public names of a subject: functions first, then classes, each as `casswarm` lists them."""
    claimed = {module for modules in SUBJECTS.values() for module in modules}
    modules = SUBJECTS.get(subject)
    found = [
        name
        for module, names in casswarm._HOME.items()
        if (module not in claimed if modules is None else module in modules)
        for name in names
    ]
    return sorted(found, key=lambda name: inspect.isclass(getattr(casswarm, name)))


def reference(names: list[str]) -> str:
    """A table of names and their entries, as reStructuredText."""
    lines = [".. currentmodule:: casswarm", "", ".. autosummary::", "   :nosignatures:", ""]
    lines += [f"   {name}" for name in names] + [""]
    for name in names:
        value = getattr(casswarm, name)
        lines += [f".. {_kind(value)}:: casswarm.{name}", *_options(value), ""]
    return "\n".join(lines)


def _kind(value: object) -> str:
    if not inspect.isclass(value):
        return "autofunction"
    return "autoexception" if issubclass(value, Exception) else "autoclass"


def _options(value: object) -> list[str]:
    if not inspect.isclass(value):
        return []
    if issubclass(value, Exception):
        return ["   :show-inheritance:", "   :no-members:"]
    return ["   :members:"]


class PublicNames(SphinxDirective):
    """``{public-names} SUBJECT``; nothing where the subject has no names."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """The table and the entries."""
        subject = self.arguments[0]
        if subject != "more" and subject not in SUBJECTS:
            raise self.error(f"no subject {subject!r}; known: {', '.join(SUBJECTS)}, more")
        names = names_of(subject)
        if not names:
            return []
        return self.parse_text_to_nodes("```{eval-rst}\n" + reference(names) + "\n```\n")


class PublicName(SphinxRole):
    """A name in a docstring: a link where it is documented, else code."""

    def run(self) -> tuple[list[nodes.Node], list[nodes.system_message]]:
        """A reference that may lead nowhere."""
        role = self.env.domains.python_domain.role("obj")
        assert role is not None
        found, messages = role(
            "obj",
            self.rawtext,
            self.text,
            self.lineno,
            self.inliner,
            self.options,
            self.content,
        )
        for node in found:
            if isinstance(node, nodes.Element):
                node["may_lead_nowhere"] = True
        return found, messages


def leave_as_code(
    _app: Sphinx, _env: object, node: nodes.Element, content: nodes.Node
) -> nodes.Node | None:
    """A name that is not documented stays as it is, without a warning."""
    return content if node.get("may_lead_nowhere") else None


def setup(app: Sphinx) -> dict[str, Any]:
    """The directive, the role, and what becomes of names that lead nowhere."""
    app.add_directive("public-names", PublicNames)
    app.add_role("public", PublicName())
    app.connect("missing-reference", leave_as_code)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
