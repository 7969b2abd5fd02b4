"""What people read is spelled right, in plain words, and names only files that exist."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]
READ = [
    *PAGES,
    *(
        path
        for folder in ("src", "studies", "workflows", "optimisations", "measurements", "docs")
        for ending in ("py", "toml", "html", "js", "css", "txt")
        for path in sorted((ROOT / folder).rglob(f"*.{ending}"))
    ),
]
FOLDERS = "studies|workflows|benchmarks|docs|tests|optimisations|measurements"


def spelled(*files: Path) -> str:
    """What codespell says of files; nothing where all words are right."""
    pytest.importorskip("codespell_lib")
    words = [sys.executable, "-m", "codespell_lib", *files]
    return subprocess.run(words, capture_output=True, text=True, cwd=ROOT).stdout


def test_words_are_spelled_right():
    """Exact: pages, docstrings, comments, messages, templates and example files; exceptions stand in pyproject.toml."""
    assert spelled(*READ) == ""


def test_a_wrong_word_is_seen(tmp_path):
    (tmp_path / "page.md").write_text("A paramter of the roller, to and fro.")
    assert spelled(tmp_path / "page.md").endswith("page.md:1: paramter ==> parameter\n")


def test_pages_name_no_host_outside():
    """Addresses are those of this machine, or names reserved for examples."""
    for page in PAGES:
        hosts = re.findall(r"\bhttps?://([\w.-]+)", page.read_text(encoding="utf-8"))
        assert [host for host in hosts if host != "127.0.0.1" and not host.endswith(".example")] == [], page


def test_files_that_the_code_names_exist():
    """Docstrings, comments, messages and templates that lead to a page, a study or a benchmark."""
    missing = [
        f"{path.relative_to(ROOT)}: {named}"
        for path in (*sorted((ROOT / "src").rglob("*.*")), *sorted((ROOT / "benchmarks").glob("*.*")))
        if path.suffix in (".py", ".toml", ".html", ".js", ".md")
        for named in re.findall(rf"(?<![\w/])(?:{FOLDERS})/[\w/]+\.\w+", path.read_text(encoding="utf-8"))
        if not (ROOT / named).exists()
    ]
    assert missing == []


SOURCES = [
    path.as_posix()
    for folder in ("src", "tests", "docs", "benchmarks", "measurements")
    for path in (ROOT / folder).rglob("*.py")
]


def test_modules_that_pages_name_exist():
    """Regression: a renamed module was still named in running text, where no link would break."""
    for page in PAGES:
        text = "" if page.name == "CHANGELOG.md" else page.read_text(encoding="utf-8")
        written = set(re.findall(r"[Ss]ave this as\s+`([^`]+)`", text))
        named = set(re.findall(r"`((?:[\w-]+/)*[\w-]+\.py)`", text)) - written
        assert [name for name in sorted(named) if not any(path.endswith(f"/{name}") for path in SOURCES)] == [], page
        dotted = re.findall(r"\btripod_doe\.([\w.]*\w)", text)
        written = {name.replace("/", ".") for name in re.findall(r"^# src/tripod_doe/(.+)\.py$", text, re.MULTILINE)}
        assert [name for name in sorted({*dotted} - written) if not _exists(name.split("."))] == [], page


def _exists(parts: list[str]) -> bool:
    """Whether a module of the package, or a name that one defines or imports, is there."""
    place = (ROOT / "src" / "tripod_doe").joinpath(*parts)
    if place.is_dir() or place.with_suffix(".py").exists():
        return True
    holder = next(
        (path for path in (place.parent.with_suffix(".py"), place.parent / "__init__.py") if path.exists()), None
    )
    defined = rf"(?m)^(?:def |class )?{parts[-1]}\b|^from .* import .*\b{parts[-1]}\b|^    {parts[-1]},$"
    return holder is not None and re.search(defined, holder.read_text(encoding="utf-8")) is not None


def test_a_dotted_name_that_is_not_there_is_seen():
    assert _exists(["joint", "values"])
    assert _exists(["joint", "values", "JointValues"])
    assert not _exists(["joint", "constants"])
    assert not _exists(["joint", "values", "Constants"])


STALE = re.compile(r"\b(?:told|so many|nobody|those of|that of|dear(?:er|est)?)\b", re.IGNORECASE)
"""Words that a reader stumbles over; each has a plainer one."""
PLAIN = [
    *(path for path in PAGES if path.name != "CHANGELOG.md"),
    *(
        path
        for folder in ("cli", "motion_page", "page_parts", "reports")
        for path in sorted((ROOT / "src" / "tripod_doe" / folder).rglob("*.*"))
        if path.suffix in (".py", ".html", ".toml", ".js")
    ),
]


SAID = [
    path
    for ending in ("py", "html", "toml")
    for path in sorted((ROOT / "src" / "tripod_doe").rglob(f"*.{ending}"))
    if path not in PLAIN
]


def said(path: Path) -> list[str]:
    """What a file can show to users: texts of Python that are no docstrings, and all lines of other files."""
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".py":
        return text.splitlines()
    tree = ast.parse(text)
    alone = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    texts = (node for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str))
    return [node.value for node in texts if id(node) not in alone]


def test_sentences_of_all_other_code_are_plain():
    """Regression: captions, claims and refusals had words that pages and commands were free of."""
    found = {path.relative_to(ROOT).as_posix(): [text for text in said(path) if STALE.search(text)] for path in SAID}
    assert {path: texts for path, texts in found.items() if texts} == {}


def test_a_stale_sentence_is_seen(tmp_path):
    path = tmp_path / "code.py"
    path.write_text('"""Those of a module."""\nX = f"so many {1} points"  # those of a comment\n')
    assert [text for text in said(path) if STALE.search(text)] == ["so many "]


def test_words_are_plain():
    for path in PLAIN:
        lines = enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
        assert [(at, line) for at, line in lines if STALE.search(line) and "match = [" not in line] == [], path
