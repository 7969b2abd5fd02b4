"""The lists of links on the first page are the navigation of the site, so that it is written once."""

from __future__ import annotations

import re

from sphinx.application import Sphinx

_SECTION = re.compile(r"^## ([^\n]+)\n(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)
_PAGE = re.compile(r"^- .*?\]\(([^)#]+)\.(?:md|ipynb)\)", re.MULTILINE)


def _add_navigation(app: Sphinx, docname: str, source: list[str]) -> None:
    if docname != app.config.root_doc:
        return
    for title, text in _SECTION.findall(source[0]):
        if pages := _PAGE.findall(text):
            source[0] += "\n".join(["", "```{toctree}", ":hidden:", f":caption: {title}", "", *pages, "```", ""])


def setup(app: Sphinx) -> dict[str, bool]:
    """Add hidden tables of contents to the first page, one for each of its sections."""
    app.connect("source-read", _add_navigation)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
