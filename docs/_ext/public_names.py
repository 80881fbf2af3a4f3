"""The reference of public names, from their docstrings; it has every name of ``casswarm.__all__``.

``{public-names} SUBJECT`` documents the names whose modules belong to a subject: a table, then
name by name. Modules that no subject claims are the subject ``more``, so that nothing is left out.
``{names-of} MODULE NAME...`` documents what is not handed out by `casswarm` itself: the given names
of a module, or all in its ``__all__``.
"""

from __future__ import annotations

import inspect
from importlib import import_module
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util.docutils import SphinxDirective, SphinxRole
from sphinx.util.nodes import make_refnode

import casswarm

SUBJECTS = {
    "scenarios": ("scenario",),
    "hazards": ("hazard",),
    "guides": ("planning", "guide", "certificate.refinement", "certificate.value"),
    "swarms": ("swarm", "certificate.success"),
    "policies": ("policies",),
    "studies": ("study", "pilot", "sweeping"),
    "laws": ("evaluation", "chain.law", "chain.hybrid"),
    "solvers": ("solvers", "solution"),
    "comparison": ("comparison",),
    "figures": ("figures.animation",),
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


def others_of(module: str) -> list[str]:
    """Functions and classes in a module's ``__all__`` that are no public names of `casswarm`."""
    found = import_module(module)
    return [
        name
        for name in found.__all__
        if name not in casswarm.__all__ and callable(getattr(found, name))
    ]


def reference(module: str, names: list[str]) -> str:
    """A table of names and their entries, as reStructuredText."""
    lines = [f".. currentmodule:: {module}", "", ".. autosummary::", "   :nosignatures:", ""]
    lines += [f"   {name}" for name in names] + [""]
    for name in names:
        value = getattr(import_module(module), name)
        lines += [f".. {_kind(value)}:: {module}.{name}", *_options(value), ""]
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
        return self.parse_text_to_nodes(f"```{{eval-rst}}\n{reference('casswarm', names)}\n```\n")


class NamesOf(SphinxDirective):
    """``{names-of} MODULE NAME...``."""

    required_arguments = 1
    optional_arguments = 100

    def run(self) -> list[nodes.Node]:
        """The table and the entries."""
        module, *names = self.arguments
        text = reference(module, names or others_of(module))
        return self.parse_text_to_nodes(f"```{{eval-rst}}\n{text}\n```\n")


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


def fallbacks(
    app: Sphinx, env: BuildEnvironment, node: nodes.Element, content: nodes.TextElement
) -> nodes.Node | None:
    """A public name, seen from another module; what is not documented stays as it is."""
    if not node.get("may_lead_nowhere"):
        return None
    name = f"casswarm.{node['reftarget']}"
    place = env.domains.python_domain.objects.get(name)
    if place is None:
        return content
    return make_refnode(app.builder, node["refdoc"], place.docname, place.node_id, content, name)


def setup(app: Sphinx) -> dict[str, Any]:
    """The directives, the role, and what becomes of names that lead nowhere."""
    app.add_directive("public-names", PublicNames)
    app.add_directive("names-of", NamesOf)
    app.add_role("public", PublicName())
    app.connect("missing-reference", fallbacks)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
