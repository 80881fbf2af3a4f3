"""How the site is built: sphinx-build -W docs docs/_build/html."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

from casswarm import __version__

project = "casswarm"
author = "The casswarm developers"
copyright = author  # noqa: A001  # Sphinx wants this name
version = release = __version__

extensions = [
    "myst_nb",  # Markdown, and notebooks
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
    "sphinx_click",
    "sphinx_copybutton",
    "command_help",
    "docstrings",
    "notebook_pages",
    "page_trees",
    "public_names",
    "repository_links",
    "scenario_keys",
]
exclude_patterns = ["_build", "**.ipynb_checkpoints"]
smartquotes = False  # else --runs becomes a dash and a word
nitpicky = True

# --- pages

myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
highlight_language = "none"  # of blocks that name none: what commands print
myst_heading_anchors = 3  # links to sections, as GitHub names them
copybutton_prompt_text = r"\$ |>>> |\.\.\. "
copybutton_prompt_is_regexp = True

# --- notebooks: the scripts in notebooks/, executed once and kept until they change

nb_execution_mode = "cache"
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_merge_streams = True

# --- reference

default_role = "public"  # names in docstrings: a link where the name is documented
autosummary_generate = False  # no files: tables of what is on the same page
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # docstrings tell types, and the shapes that annotations cannot
napoleon_use_param = False
napoleon_use_rtype = False
python_use_unqualified_type_names = True
toc_object_entries_show_parents = "hide"

# --- links: looked up by `sphinx-build -b linkcheck`, which needs the network

linkcheck_timeout = 20
linkcheck_retries = 2

# --- looks

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
