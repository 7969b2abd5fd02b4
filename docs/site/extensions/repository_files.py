"""Links to files of the repository lead to pages that show them, so that a site has what its pages speak of."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import Any

from docutils import nodes
from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import TextLexer, get_lexer_for_filename
from pygments.util import ClassNotFound
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.transforms import SphinxTransform

ROOT = Path(__file__).resolve().parents[3]


class FileLinks(SphinxTransform):
    """Takes links to files before they become downloads."""

    default_priority = 400

    def apply(self, **words: Any) -> None:
        """Note the files that a page links to."""
        here = Path(self.env.doc2path(self.env.docname)).parent
        for node in list(self.document.findall(_is_link)):
            outside = isinstance(node, addnodes.pending_xref)  # Markdown that is no page; its suffix was dropped
            path = (here / (node["reftarget"] + ".md" * outside)).resolve()
            if not path.is_relative_to(ROOT) or (outside and not path.is_file()):
                continue
            place = path.relative_to(ROOT).as_posix()
            _linked(self.env).setdefault(self.env.docname, set()).add(place)
            node.replace_self(nodes.reference("", "", *node.children, repository_file=place, internal=True, refuri=""))


def _is_link(node: nodes.Node) -> bool:
    if isinstance(node, addnodes.pending_xref):
        return str(node["reftarget"]).startswith("/")
    return isinstance(node, addnodes.download_reference)


def _linked(env: BuildEnvironment) -> dict[str, set[str]]:
    """Files by the page that links to them."""
    if not hasattr(env, "repository_files"):
        env.repository_files = {}  # type: ignore[attr-defined]
    return env.repository_files  # type: ignore[attr-defined, no-any-return]


def _point(app: Sphinx, doctree: nodes.document, docname: str) -> None:
    for node in doctree.findall(nodes.reference):
        if place := node.get("repository_file"):
            node["refuri"] = app.builder.get_relative_uri(docname, f"files/{place}")


def _forget(app: Sphinx, env: BuildEnvironment, docname: str) -> None:
    _linked(env).pop(docname, None)


def _merge(app: Sphinx, env: BuildEnvironment, docnames: list[str], other: BuildEnvironment) -> None:
    _linked(env).update({name: places for name, places in _linked(other).items() if name in docnames})


def _pages(app: Sphinx) -> Iterator[tuple[str, dict[str, Any], str]]:
    formatter = HtmlFormatter(lineanchors="line")
    for place in sorted(set().union(*_linked(app.env).values())):
        text = (ROOT / place).read_text(encoding="utf-8")
        try:
            lexer = get_lexer_for_filename(place)
        except ClassNotFound:
            lexer = TextLexer()
        body = f"<h1 class='place'>{escape(place)}</h1>\n{highlight(text, lexer, formatter)}"
        yield f"files/{place}", {"title": place, "body": body, "furo_hide_toc": True}, "page.html"


def setup(app: Sphinx) -> dict[str, Any]:
    """Show the files that pages link to."""
    app.add_transform(FileLinks)
    app.connect("env-purge-doc", _forget)
    app.connect("env-merge-info", _merge)
    app.connect("doctree-resolved", _point)
    app.connect("html-collect-pages", _pages)
    return {"version": "1", "env_version": 1, "parallel_read_safe": True, "parallel_write_safe": True}
