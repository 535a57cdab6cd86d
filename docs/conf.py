"""Settings by which Sphinx builds the site. Build it with  python docs/build.py."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import springgym  # noqa: E402

PYPROJECT = tomllib.loads((HERE.parent / "pyproject.toml").read_text(encoding="utf-8"))

project = "springgym"
author = "The springgym authors"
copyright = "2026, the springgym authors"
version = release = springgym.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "site_extension",
]

templates_path = ["_templates"]
html_theme = "furo"
html_title = "springgym"
html_favicon = "_static/icon.svg"
pygments_dark_style = "github-dark"
html_static_path = ["_static", "_media"]
html_css_files = ["site.css"]
html_js_files = ["films.js"]
html_show_sphinx = False
html_theme_options = {"navigation_with_keys": True, "source_branch": "main", "source_directory": "docs/"}
if "urls" in PYPROJECT["project"]:
    html_theme_options["source_repository"] = PYPROJECT["project"]["urls"]["Source"]
html_math_renderer = "svg"
exclude_patterns = ["_build", "_media", "**.ipynb_checkpoints"]

# --- Markdown and notebooks ---------------------------------------------------------------------------

myst_enable_extensions = ["dollarmath", "deflist", "colon_fence"]
myst_heading_anchors = 4
nb_execution_mode = "off"  # `docs/notebooks.py` writes the outputs
nb_merge_streams = True
copybutton_exclude = ".linenos, .gp, .go"

# --- Reference ----------------------------------------------------------------------------------------

autosummary_generate = True
autosummary_ignore_module_all = False
autosummary_context = {"public": springgym._PUBLIC}
autodoc_member_order = "bysource"
autodoc_inherit_docstrings = False
autodoc_typehints = "none"  # the docstrings say shapes and units
autodoc_default_options = {"members": True}
autodoc_preserve_defaults = True
default_role = "code"
napoleon_numpy_docstring = True
napoleon_google_docstring = False
napoleon_use_rtype = False
suppress_warnings = ["ref.python"]  # "(centre, radius)" as the form of an argument names no class
