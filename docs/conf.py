"""Configuration of the site: sphinx-build -W docs docs/_build/html."""

from __future__ import annotations

import hashlib
import shutil
import sys
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.nodes import make_refnode

from casswarm import __version__

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path.insert(0, str(HERE / "_ext"))

project = "casswarm"
author = "The casswarm developers"
copyright = author  # noqa: A001  Sphinx wants this name
version = release = __version__

extensions = [
    "myst_nb",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",  # formulas without network
    "sphinx.ext.viewcode",
    "sphinx_click",
    "sphinx_copybutton",
    "command_help",  # sphinx-click prints examples and defaults as plain paragraphs
    "repository_links",  # links such as ../LICENSE work on GitHub and on the site
    "scenario_keys",  # the reference of scenario files, from the pydantic schema
]
exclude_patterns = ["_build", "_ext", "*.py", "examples", "**.ipynb_checkpoints"]
smartquotes = False  # else --runs becomes a dash and a word

# --- pages

myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
highlight_language = "none"  # blocks without a language show printed output
myst_heading_anchors = 3  # links to sections, as GitHub names them
copybutton_prompt_text = r"\$ |>>> |\.\.\. "
copybutton_prompt_is_regexp = True

# --- notebooks: the scripts in notebooks/, executed and cached until they or casswarm change


def package_fingerprint() -> str:
    """Hash of the package's sources, on which the notebooks' results depend."""
    digest = hashlib.sha256()
    for folder in ("casswarm", "problems"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


# Sphinx reads sources below docs/ only
shutil.rmtree(HERE / "notebooks", ignore_errors=True)
shutil.copytree(ROOT / "notebooks", HERE / "notebooks")
nb_custom_formats = {".py": ["jupytext.reads", {"fmt": "py:percent"}]}
nb_execution_mode = "cache"
nb_execution_cache_path = str(HERE / "_build" / ".jupyter_cache" / package_fingerprint())
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_merge_streams = True

# --- reference

default_role = "py:obj"  # names in docstrings are links where they are documented
templates_path = ["_templates"]
autosummary_generate = True
autosummary_imported_members = True
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # docstrings state types, and the shapes that annotations cannot
numpydoc_show_class_members = False  # autodoc lists them
python_use_unqualified_type_names = True
toc_object_entries_show_parents = "hide"


def public_name(app: Sphinx, env: Any, node: nodes.Element, content: nodes.Element) -> Any:
    """Resolve a public name that a docstring of another module mentions without `casswarm.`."""
    name = f"casswarm.{node.get('reftarget')}"
    entry = env.domains.python_domain.objects.get(name)
    if entry is None:
        return None
    return make_refnode(app.builder, node["refdoc"], entry.docname, entry.node_id, content, name)


def setup(app: Sphinx) -> None:
    """Connect the resolver of public names."""
    app.connect("missing-reference", public_name)


# --- links: `sphinx-build -b linkcheck` checks them, which needs the network

linkcheck_timeout = 20
linkcheck_retries = 2

# --- theme

html_theme = "furo"
html_title = f"casswarm {version}"
html_static_path = ["_static"]
html_css_files = ["casswarm.css"]
html_copy_source = False
html_show_copyright = False
html_theme_options = {
    "light_css_variables": {
        "color-brand-primary": "#0072b2",
        "color-brand-content": "#0072b2",
    },
    "dark_css_variables": {
        "color-brand-primary": "#56b4e9",
        "color-brand-content": "#56b4e9",
    },
}
