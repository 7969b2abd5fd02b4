"""Results that were copied into the directory of others together with their checksums: refused, and named by check."""

import json
import shutil

import pytest

from tripod_doe.cli import main
from tripod_doe.errors import CubeError
from tripod_doe.files.checksum_list import LIST, checksums, refuse_changed, write_listed
from tripod_doe.study.cube.file_checks import ANALYSES, refuse_unfit
from tripod_doe.study.cube.file_digest import seal
from tripod_doe.study.journal import Journal
from tripod_doe.study.result_directory.directory import make_directory


def study(path, text):
    """A directory as a study leaves it, with a page."""
    Journal(make_directory(path)).close()
    write_listed(path / "report" / "index.html", text)
    return path


def workflow(path, text):
    """A directory as a workflow or a search leaves it, with a step that computes and one that draws."""
    write_listed(path / "base.toml", text)
    study(path / "steps" / "points", text)
    write_listed(path / "steps" / "figure" / "figures.json", text)
    write_listed(path / "report" / "index.html", text)
    return path


def damaged(path, capsys):
    """Names of the files that check calls damaged."""
    main(["check", str(path), "--format", "json"])
    entries = json.loads(capsys.readouterr().out)
    return {entry["file"].removeprefix(f"{path}/"): entry["damage"] for entry in entries if entry["damage"]}


@pytest.mark.parametrize(
    ("make", "copied", "asked", "named"),
    [
        (study, ["report"], "report/index.html", f"report/{LIST}"),
        (workflow, ["report"], "report/index.html", f"report/{LIST}"),
        (workflow, ["report", "base.toml", LIST], "report/index.html", LIST),
        (workflow, ["report", "base.toml", LIST], "base.toml", LIST),
        (workflow, ["steps/figure"], "steps/figure/figures.json", f"steps/figure/{LIST}"),
        (workflow, ["steps/points"], "steps/points/report/index.html", f"steps/points/report/{LIST}"),
        (workflow, ["steps/points/report"], "steps/points/report/index.html", f"steps/points/report/{LIST}"),
        (workflow, ["steps/points/journal.sqlite"], "steps/points/report/index.html", f"steps/points/report/{LIST}"),
    ],
)
def test_files_of_another_directory_are_refused(tmp_path, capsys, make, copied, asked, named):
    """Regression: they were served in silence, and check called them whole."""
    mine, other = make(tmp_path / "mine", "mine"), make(tmp_path / "other", "other")
    assert not damaged(mine, capsys)
    for name in copied:
        if (other / name).is_dir():
            shutil.rmtree(mine / name)
            shutil.copytree(other / name, mine / name)
        else:
            shutil.copy(other / name, mine / name)
    with pytest.raises(CubeError, match="files of another directory were copied here"):
        refuse_changed(mine / asked)
    assert "files of another directory" in damaged(mine, capsys)[named]


def test_an_analysis_in_a_step_of_another_directory_is_refused(tmp_path):
    """Regression: its cube was refused, and its analyses were read."""
    mine, other = workflow(tmp_path / "mine", "mine"), workflow(tmp_path / "other", "other")
    analysis = other / "steps" / "points" / ANALYSES / "effects.nc"
    analysis.parent.mkdir()
    analysis.write_bytes(b"no matter what")
    seal(analysis)
    write_listed(other / "steps" / "points" / "step.json", "other")
    shutil.rmtree(mine / "steps" / "points")
    shutil.copytree(other / "steps" / "points", mine / "steps" / "points")
    with pytest.raises(CubeError, match="files of another directory were copied here"):
        refuse_unfit(mine / "steps" / "points" / ANALYSES / "effects.nc")


def test_a_copy_of_a_whole_directory_or_of_a_step_alone_is_read(tmp_path, capsys):
    mine = workflow(tmp_path / "mine", "mine")
    for name, part in {"whole": "", "points": "steps/points", "page": "report"}.items():
        copy = shutil.copytree(mine / part, tmp_path / "copies" / name)
        assert not damaged(copy, capsys)
        refuse_changed(copy / ("index.html" if part == "report" else "report/index.html"), unlisted=True)


def test_what_is_written_again_no_longer_counts_as_copied(tmp_path):
    mine, other = study(tmp_path / "mine", "mine"), study(tmp_path / "other", "other")
    write_listed(other / "report" / "summary.html", "other")
    shutil.copytree(other / "report", mine / "report", dirs_exist_ok=True)
    page = write_listed(mine / "report" / "index.html", "mine")
    refuse_changed(page, unlisted=True)
    assert checksums(page.parent).keys() == {"index.html"}


def test_a_directory_that_lost_its_list_stays_that_of_its_steps(tmp_path, capsys):
    mine = workflow(tmp_path / "mine", "mine")
    (mine / LIST).unlink()
    write_listed(mine / "base.toml", "mine")
    assert not damaged(mine, capsys)
