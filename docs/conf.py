"""The documentation site: ``make docs`` builds it into out/docs, with the theme and the directives of Mitsuba's manual."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE / "extensions"))

project = "SGTD"
author = "the SGTD authors"
copyright = "2026, the SGTD authors"
html_title = "SGTD"

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx_copybutton",
    "sphinx_design",
    "myst_nb",
    "sphinx_click",
    "mitsuba_directives",
    "plugin_pages",
]
exclude_patterns = ["plugins/generated/*", "strips/*", "**/.ipynb_checkpoints"]

# What Mitsuba's manual defines, so that the plugin pages read alike there and here
rst_prolog = r"""
.. role:: paramtype
.. role:: monosp
.. |spectrum| replace:: :paramtype:`spectrum`
.. |texture| replace:: :paramtype:`texture`
.. |float| replace:: :paramtype:`float`
.. |boolean| replace:: :paramtype:`boolean`
.. |bool| replace:: :paramtype:`boolean`
.. |string| replace:: :paramtype:`string`
.. |false| replace:: :monosp:`false`
.. |true| replace:: :monosp:`true`
.. |exposed| replace:: :abbr:`P (mi.traverse shows this parameter)`
.. |differentiable| replace:: :abbr:`∂ (this parameter can be differentiated)`
.. |discontinuous| replace:: :abbr:`D (this parameter may move discontinuities, which need care when it is differentiated)`
"""

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

# Tutorials run when the site is built, in the environment that builds it: what they show is what this version does
nb_execution_mode = "force"
nb_execution_timeout = 240
nb_execution_raise_on_error = True
nb_merge_streams = True

# "--set" is two hyphens
smartquotes = False

autodoc_member_order = "bysource"
autodoc_typehints = "none"

html_theme = "furo"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_show_sourcelink = False
