"""The how-to guides: each fits on a screen, and its commands print what it shows, beside a study that has run."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from executed_page import execute_page
from tripod_doe.cli.main import main

ROOT = Path(__file__).parents[2]
LONG = {"extending"}
"""Of more than a screen, with a test of its own."""
GUIDES = [path for path in sorted((ROOT / "docs" / "guides").glob("*.md")) if path.stem not in LONG]
LINES, WORDS = 80, 380
SLOW = {"best_joint", "below_a_limit", "halve_a_friction", "which_friction", "which_friction_does_my_joint_have"}
SLOW |= {"an_output_that_is_not_there", "how_long_will_it_take", "my_own_points", "show_it_to_a_colleague"}


def marked(path):
    return pytest.param(path, id=path.stem, marks=[pytest.mark.slow] if path.stem in SLOW else [])


@pytest.fixture(scope="session")
def clone(tmp_path_factory):
    """A folder with the example files, and a study that has run."""
    folder = tmp_path_factory.mktemp("clone")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr("tripod_doe.workflow.run_study.write_report", lambda directory, findings: None)
        assert main(["init", "--kind", "examples"]) == 0
        assert main(["init", "my_joint"]) == 0
        assert main(["run", "my_joint.toml", "--out", "results/my_joint", "--workers", "0"]) == 0
    return folder


def test_twenty_guides_are_one_screen_each():
    assert len(GUIDES) >= 20
    for path in GUIDES:
        text = path.read_text(encoding="utf-8")
        assert len(text.splitlines()) <= LINES, path.name
        assert len(text.split()) <= WORDS, path.name


@pytest.mark.usefixtures("charts_not_drawn")
@pytest.mark.parametrize("guide", [marked(path) for path in GUIDES])
def test_a_guide_does_what_it_says(guide, clone, tmp_path, monkeypatch):
    """Regression: its files are written, its commands run, and print what is shown below them."""
    shutil.copytree(clone, tmp_path / "clone", symlinks=True)
    monkeypatch.chdir(tmp_path / "clone")
    execute_page(guide)
