"""Notes in Markdown: what people mean is seen, and no note of a stranger does more than show text."""

from __future__ import annotations

import time
from html.parser import HTMLParser

import pytest

from tripod_doe.page_parts.markdown import markdown, plain_lines

ALLOWED = {"p", "br", "strong", "em", "code", "pre", "ul", "ol", "li", "blockquote", "hr", "a"}
NOTE = (
    "# Steel\nby *hand*\nat night\n\n1. [drawing](https://example.org/a?b=1&c=2)\n2. `F = 3 N`\n\n> <ada@example.org>\n"
)
HOSTILE = [
    "<script>alert(1)</script>",
    "<img src=x onerror=alert(1)>",
    "<svg/onload=alert(1)>",
    "<iframe src=//evil.example></iframe>",
    "<style>*{display:none}</style>",
    "<!-- --><b onclick=x>y</b>",
    "<a href='javascript:alert(1)'>x</a>",
    "<form action=//evil.example><input></form>",
    "[x](javascript:alert(1))",
    "[x](JaVaScRiPt:alert(1))",
    "[x](java\tscript:alert(1))",
    "[x](&#106;avascript:alert(1))",
    "[x](\\javascript:alert(1))",
    "[x](data:text/html;base64,PHNjcmlwdD4=)",
    "[x](vbscript:msgbox(1))",
    "[x](file:///etc/passwd)",
    "[x](//evil.example)",
    "[x](/api/v1/runs)",
    "[x](../../etc)",
    "[x](#main)",
    "[x](ftp://evil.example)",
    "[x](blob:http://127.0.0.1/1)",
    "[x](http:evil)",
    "[x]( javascript:alert(1) )",
    "[x](<javascript:alert(1)>)",
    "[x][y]\n\n[y]: javascript:alert(1)",
    "[x][y]\n\n[y]: data:text/html,1 'title'",
    "<javascript:alert(1)>",
    "<data:text/html,1>",
    "![x](https://evil.example/pixel.png)",
    "![x](javascript:alert(1))",
    "![x][y]\n\n[y]: https://evil.example/pixel.png",
    "[x](https://example.org \"a' onclick='alert(1)\")",
    '[x](https://example.org/"onmouseover="alert(1))',
    "[x](https://example.org/<script>)",
    '[a](https://example.org "\\"><script>alert(1)</script>")',
    "```<script>\nalert(1)\n```",
    '```"onclick="x\nalert(1)\n```',
    "~~~ js class='x'\n</code></pre><script>alert(1)</script>\n~~~",
    "`</code><script>alert(1)</script>`",
    "    </pre><script>alert(1)</script>",
    "# <script>alert(1)</script>",
    "> <script>alert(1)</script>",
    "- <details open ontoggle=alert(1)>",
    "&lt;script&gt;alert(1)&lt;/script&gt;",
    "&#60;script&#62;alert(1)&#60;/script&#62;",
    "**<b>**</b>",
    "</div></main><script>alert(1)</script>",
    "{{ 7 * 7 }} {% raw %}",
    "\\<script\\>",
    "\u202e[x](https://example.org)",
]
LARGE = ["[" * 20_000, "![" * 10_000, "*a " * 6_000, "[a](" * 5_000, "> " * 10_000, "- " * 10_000, "<a@" * 6_000]


class Seen(HTMLParser):
    """Tags and attributes of a page, and its text."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.attributes, self.text = [], [], ""
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.attributes += attributes

    def handle_data(self, data):
        self.text += data


def test_what_is_typed_is_seen_as_meant():
    seen = Seen(markdown(NOTE))
    assert seen.tags == ["p", "strong", "p", "em", "br", "ol", "li", "a", "li", "code", "blockquote", "p", "a"]
    links = [value for name, value in seen.attributes if name == "href"]
    assert links == ["https://example.org/a?b=1&c=2", "mailto:ada@example.org"]
    assert plain_lines(NOTE) == ["Steel", "by hand", "at night", "• drawing", "• F = 3 N", "ada@example.org"]


@pytest.mark.parametrize("note", HOSTILE)
def test_a_note_of_a_stranger_shows_text_and_nothing_else(note):
    seen = Seen(markdown(note))
    assert set(seen.tags) <= ALLOWED
    assert {name for name, _ in seen.attributes} <= {"href", "title", "target", "rel", "class"}
    for name, value in seen.attributes:
        assert name != "href" or value.startswith(("http://", "https://", "mailto:"))
        assert name != "class" or value.startswith("language-")


@pytest.mark.slow
def test_a_large_note_takes_a_moment():
    """Linear time: at most half a second each for 20,000 letters."""
    start = time.process_time()
    for note in LARGE:
        markdown(note)
    assert time.process_time() - start < 5
