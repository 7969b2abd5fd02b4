"""What was made of earlier results is gone before new ones replace them: a kill at any moment leaves none as theirs."""

import os
import shutil

import pytest

import tripod_doe as td
from tripod_doe.files.checksum_list import write_listed
from tripod_doe.study.cube.file_checks import analysis_files
from tripod_doe.study.result_directory.check import check_files
from tripod_doe.workflow import optimise, run_study, run_workflow
from tripod_doe.workflow.steps_file import STEPS, begin_search, read_steps

STUDY = """
    [study]
    name = "grown"
    function = "of_earlier_results:square"
    [factors]
    x = {{values = [{values}]}}
    [analysis.effects]
"""
WORKFLOW = '[workflow]\nname = "grown"\n[steps.points]\nkind = "study"\nstudy = "study.toml"\n' + (
    '[steps.effects]\nkind = "analysis"\nanalysis = "effects"\ninputs = ["points"]\n'
)
HANDED_ON = ("index.html", "summary.pdf", "figures/effects.svg")

pytestmark = pytest.mark.usefixtures("pages_not_made", "charts_not_drawn")


@pytest.fixture(autouse=True)
def square(tmp_path, monkeypatch):
    (tmp_path / "of_earlier_results.py").write_text("def square(x):\n    return {'y': x * x}\n")
    monkeypatch.syspath_prepend(tmp_path)


def killed(*words, **options):
    raise KeyboardInterrupt


def test_a_study_that_is_killed_before_its_analyses(write_study, tmp_path, monkeypatch):
    """Regression: the report and the one page of the smaller study were there, beside the cube of the larger one."""
    out = tmp_path / "out"
    td.run(write_study(STUDY.format(values="1, 2, 3")), out, workers=0, progress=False)
    for name in HANDED_ON:
        write_listed(out / "report" / name, "of three points")
    mine = out / "report" / "mine.txt"
    mine.write_text("not of this program")
    monkeypatch.setattr(run_study, "run_analyses", killed)
    with pytest.raises(KeyboardInterrupt):
        td.run(write_study(STUDY.format(values="1, 2, 3, 4")), out, workers=0, progress=False)
    assert td.open_cube(out).sizes["x"] == 4
    assert [path for path in (out / "report").rglob("*") if path.suffix in (".html", ".pdf", ".svg", ".txt")] == [mine]
    assert not analysis_files(out)
    assert all(file.is_whole for file in check_files(out))


def test_a_workflow_that_is_killed_in_a_step(write_study, tmp_path, monkeypatch):
    """Regression: the page and the result of the step before were still there."""
    out, file = tmp_path / "out", tmp_path / "chain.toml"
    file.write_text(WORKFLOW)
    write_study(STUDY.format(values="1, 2, 3"))
    td.run_workflow(file, out, workers=0, progress=False)
    result, page = out / "steps" / "effects" / "cube.nc", out / "report" / "index.html"
    assert result.is_file()
    assert page.is_file()
    write_study(STUDY.format(values="1, 2, 3, 4"))
    monkeypatch.setattr(run_workflow, "stamp_history", killed)
    with pytest.raises(KeyboardInterrupt):
        td.run_workflow(file, out, workers=0, progress=False)
    assert td.open_cube(out / "steps" / "points").sizes["x"] == 4
    assert not result.exists()
    assert not page.exists()
    monkeypatch.undo()
    monkeypatch.syspath_prepend(tmp_path)
    assert {step.state for step in td.run_workflow(file, out, workers=0, progress=False).steps} == {
        "reused",
        "finished",
    }
    assert all(file.is_whole for file in check_files(out))


@pytest.mark.parametrize("killed_in", ["optimisation_lines", "pasted"])
def test_a_search_that_is_killed(tmp_path, monkeypatch, killed_in):
    """Regression: the front of the earlier search stood there as that of the new file."""
    file, out = tmp_path / "file.toml", tmp_path / "out"
    text = (
        '[optimisation]\nname = "a"\nfunction = "of_earlier_results:square"\n[variables]\nx = {low = 1, high = 2}\n'
        '[objectives.least]\noutput = "y"\n[search]\nevaluations = 12\n'
    )
    file.write_text(text)
    td.optimise(file, out, workers=0, progress=False)
    file.write_text(text.replace("low = 1", "low = 0.5"))
    monkeypatch.setattr(optimise, killed_in, killed)
    with pytest.raises(KeyboardInterrupt):
        td.optimise(file, out, workers=0, progress=False)
    assert (out / "optimise.toml").read_text() == file.read_text()
    assert (out / "front.nc").exists() == (killed_in == "pasted")
    assert not (out / "base.toml").exists()
    assert not (out / "report" / "index.html").exists()
    assert all(file.is_whole for file in check_files(out))


def test_what_a_search_removes(tmp_path):
    (tmp_path / "of_earlier_results.py").unlink()
    for name in ("fit.nc", "fit.toml", "base.toml", STEPS, "report/index.html", "steps/points/study.toml"):
        write_listed(tmp_path / name, "earlier")
    first = (tmp_path / "checksums.sha256").read_text().splitlines()[0]
    begin_search(tmp_path, "fit.toml", "new")
    assert (tmp_path / "fit.toml").read_text() == "new"
    left = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.suffix != ".sha256"}
    assert {name for name in left if (tmp_path / name).is_file()} == {STEPS, "fit.toml", "steps/points/study.toml"}
    assert (tmp_path / "checksums.sha256").read_text().splitlines()[0] == first
    assert all(file.is_whole for file in check_files(tmp_path))
    shutil.rmtree(tmp_path / "report")
    begin_search(tmp_path, "fit.toml", "new")
    assert not (tmp_path / "report").exists()


def test_nothing_is_removed_through_a_link(write_study, tmp_path):
    """What a stranger's directory leads to may be other results, with a list of their own."""
    other = write_listed(tmp_path / "other" / "fit.nc", "mine")
    out = tmp_path / "out"
    (out / "report").mkdir(parents=True)
    (out / "report" / "figures").symlink_to(other.parent)
    with pytest.raises(td.InputError, match="report: figures is a link to"):
        td.run(write_study(STUDY.format(values="1, 2")), out, workers=0, progress=False)
    assert other.read_text() == "mine"


@pytest.mark.parametrize(("quick", "folder"), [(False, "steps"), (True, "quick")])
def test_a_workflow_removes_nothing_through_a_link(write_study, tmp_path, quick, folder):
    other = write_listed(tmp_path / "other" / "fit.nc", "mine")
    (tmp_path / "out" / folder).mkdir(parents=True)
    (tmp_path / "out" / folder / "effects").symlink_to(other.parent)
    (tmp_path / "chain.toml").write_text(WORKFLOW)
    write_study(STUDY.format(values="1, 2, 3"))
    with pytest.raises(td.InputError, match=f"{folder}: effects is a link to"):
        td.run_workflow(tmp_path / "chain.toml", tmp_path / "out", quick=quick, workers=0, progress=False)
    assert other.read_text() == "mine"


def test_a_list_of_steps_of_a_gigabyte_is_not_read(tmp_path, monkeypatch):
    """Regression: each look at a run read all of it for its checksum."""
    path = write_listed(tmp_path / STEPS, "[]")
    os.truncate(path, 1_000_000_000)
    monkeypatch.setattr("tripod_doe.files.checksum_list._digest", killed)
    assert read_steps(tmp_path) == []
