"""The site: ``python docs/site/build.py``, or ``python -m sphinx -W docs build/site``."""

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent / "site"), str(Path(__file__).parent.parent)]

import build  # noqa: E402

if missing := build.missing():
    from sphinx.errors import ConfigError

    raise ConfigError(missing)

import contents  # noqa: E402

import impactlab as il  # noqa: E402

project, author, copyright = "impactlab", "the authors of impactlab", "the authors of impactlab"
version = release = il.__version__

extensions = [
    "myst_parser", "numpydoc", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx_copybutton",
    "formulas", "reference_pages", "contents",
]  # fmt: skip
exclude_patterns = ["figures", "site"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4

default_role = "py:obj"
autosummary_generate = True
autodoc_typehints = "none"
numpydoc_show_class_members = False
templates_path = ["site/templates"]

html_theme = "pydata_sphinx_theme"
html_title = f"impactlab {il.__version__}"
html_static_path = ["site/static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_sidebars = {page: [] for page in contents.ALONE}
html_theme_options = {
    "header_links_before_dropdown": 6,
    "navigation_with_keys": False,
    "show_prev_next": True,
    "footer_start": ["copyright"],
    "footer_end": [],
}
copybutton_exclude = ".linenos, .gp"
