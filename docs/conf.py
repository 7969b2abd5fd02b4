"""Settings of the documentation's site: `sphinx-build -W docs OUT` writes it, ready for any static host.

No page needs a network or a script: styles, scripts and pictures are files of the site, formulas are MathML, and what
furo would write into each page (a style, a script) is a file too, so that a server can forbid inline code.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from pygments.lexers import TextLexer
from sphinx.application import Sphinx

_HERE = Path(__file__).parent
sys.path.insert(0, str(_HERE / "site" / "extensions"))

project = "tripod_doe"
version = release = re.search(r'^version = "(.+)"', (_HERE.parent / "pyproject.toml").read_text(), re.MULTILINE)[1]  # type: ignore[index]
html_title = f"tripod_doe {version}"
language = "en"

extensions = ["myst_parser", "mathml", "repository_files", "page_lists", "search_words"]
root_doc = "index"
exclude_patterns = ["site/**", "**.ipynb_checkpoints"]
nitpicky = True

myst_enable_extensions = ["dollarmath", "deflist", "attrs_inline"]
myst_heading_anchors = 4
myst_links_external_new_tab = False

html_theme = "furo"
html_theme_options = {"top_of_page_buttons": []}
html_math_renderer = "mathml"
html_static_path = ["site/static"]
html_css_files = ["site.css"]
templates_path = ["site/templates"]
html_favicon = "../src/tripod_doe/service/page/assets/icon.svg"
html_search_scorer = str(_HERE / "site" / "search_order.js")
html_copy_source = False
html_show_sourcelink = False
html_show_copyright = False
html_show_sphinx = False
html_use_index = False
html_domain_indices = False
html_permalinks_icon = "#"
pygments_style = "a11y-high-contrast-light"
pygments_dark_style = "a11y-high-contrast-dark"


def setup(app: Sphinx) -> None:
    """Show tables of numbers as they are: Pygments knows no CSV."""
    app.add_lexer("csv", TextLexer)
