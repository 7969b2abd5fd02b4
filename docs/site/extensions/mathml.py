"""Formulas as MathML, made while the site is built: browsers show it without a script."""

from __future__ import annotations

from html import escape

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging

_log = logging.getLogger(__name__)


def _mathml(node: nodes.Element, display: bool) -> str:
    try:
        return str(tex2mathml(node.astext(), as_block=display))
    except MathError as error:
        _log.warning("formula %r: %s", node.astext(), error, location=node)
        return f"<code>{escape(node.astext())}</code>"


def _inline(page: nodes.NodeVisitor, node: nodes.Element) -> None:
    page.body.append(_mathml(node, False))
    raise nodes.SkipNode


def _display(page: nodes.NodeVisitor, node: nodes.Element) -> None:
    page.body.append(f'<div class="math">{_mathml(node, True)}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Offer the renderer `mathml`; a formula that it cannot read is a warning."""
    app.add_html_math_renderer("mathml", (_inline, None), (_display, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
