"""Words that people search a page by, from `docs/site/search_words.toml`, as keywords of the page."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

FILE = Path(__file__).parents[1] / "search_words.toml"


def _add_keywords(app: Sphinx, document: nodes.document) -> None:
    app.env.note_dependency(str(FILE))
    if phrases := tomllib.loads(FILE.read_text(encoding="utf-8")).get(app.env.docname):
        words = dict.fromkeys(re.findall(r"\w+", " ".join(phrases)))
        document.insert(0, nodes.meta("", name="keywords", content=", ".join(words)))


def _check_pages(app: Sphinx, environment: BuildEnvironment) -> None:
    if unknown := tomllib.loads(FILE.read_text(encoding="utf-8")).keys() - environment.found_docs:
        raise ValueError(f"{FILE}: no such pages: {', '.join(sorted(unknown))}")


def setup(app: Sphinx) -> dict[str, bool]:
    """Give pages the words that they are searched by; the file names pages of the site only."""
    app.connect("doctree-read", _add_keywords)
    app.connect("env-updated", _check_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
