"""Notes in Markdown as HTML that is safe for any author, and as plain lines for print.

Raw HTML stays text, pictures are not loaded, links lead to pages and mail addresses only; headings are bold lines, as
the page around the note has headings of its own.
"""

from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any

from markdown_it import MarkdownIt
from markdown_it.token import Token
from markupsafe import Markup

_LINKS = ("http://", "https://", "mailto:")


@cache
def _parser() -> MarkdownIt:
    parser = MarkdownIt("commonmark", {"html": False, "breaks": True}).disable("image")
    parser.validateLink = lambda url: url.casefold().startswith(_LINKS)  # type: ignore[method-assign]
    parser.add_render_rule("heading_open", lambda *_: "<p><strong>")
    parser.add_render_rule("heading_close", lambda *_: "</strong></p>\n")
    parser.add_render_rule("link_open", _link_open)
    return parser


def _link_open(renderer: Any, tokens: Sequence[Token], at: int, options: Any, environment: Any) -> str:
    """A link that opens in another tab, and tells the other server nothing of it."""
    tokens[at].attrs |= {"target": "_blank", "rel": "noopener noreferrer nofollow"}
    return renderer.renderToken(tokens, at, options, environment)


@lru_cache(256)  # a note of 20,000 brackets takes half a second
def markdown(text: str) -> Markup:
    """A note as HTML."""
    return Markup(_parser().render(text))


def plain_lines(text: str) -> list[str]:
    """The words of a note, a line for each paragraph, heading or item of a list."""
    lines, item = [], ""
    for token in _parser().parse(text):
        if token.type == "list_item_open":
            item = "\u2022 "
        if token.type in ("inline", "fence", "code_block"):
            words = "".join(_words(child) for child in token.children or [token])
            lines += [(item if at == 0 else "") + line for at, line in enumerate(words.strip().splitlines())]
            item = ""
    return lines


def _words(token: Token) -> str:
    return "\n" if token.type in ("softbreak", "hardbreak") else token.content
