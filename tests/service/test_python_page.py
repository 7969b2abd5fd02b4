"""The page about Python is true: each example runs, in order, and every public name is in one."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import tripod_doe as td

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "python.md"
BLOCK = re.compile(r"(?:<!-- (\w+) -->\n)?```python\n(.*?)```", re.DOTALL)


def examples(*marks):
    """The text of the examples with one of some marks, empty for those without."""
    return [text for mark, text in BLOCK.findall(PAGE.read_text()) if mark in marks]


def run_all(texts, folder, monkeypatch, **names):
    monkeypatch.chdir(folder)
    for text in texts:
        exec(compile(text, str(PAGE), "exec"), names)


def test_every_public_name_is_in_an_example_or_in_the_table_of_errors():
    used = set(re.findall(r"\btd\.(\w+)", "".join(examples("", "slow", "service"))))
    assert used >= set(td.__all__)


@pytest.mark.slow
@pytest.mark.usefixtures("pages_not_made")
def test_each_example_runs(tmp_path, monkeypatch, serve_for_all):
    texts = examples("", "service")
    texts = [text.replace("http://127.0.0.1:8811", serve_for_all.address) for text in texts]
    run_all(texts, tmp_path, monkeypatch, token=serve_for_all.token)


@pytest.mark.slow
@pytest.mark.usefixtures("pages_not_made")
def test_each_example_with_a_search_runs(tmp_path, monkeypatch):
    run_all(examples("", "slow"), tmp_path, monkeypatch)
