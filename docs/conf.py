"""Sphinx: how the manual is built."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import pyibr

project = "pyibr"
author = "The pyibr authors"
project_copyright = f"2026, {author}"
release = version = pyibr.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
exclude_patterns = ["gallery/*", "build"]
suppress_warnings = ["config.cache"]

html_theme = "furo"
html_title = f"pyibr {release}"
html_static_path = ["_static"]
html_css_files = ["tables.css", "code.css"]

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings name types with their shapes
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True
