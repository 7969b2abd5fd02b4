"""Workflows: order, resuming without recomputing, failures that stop only what needs them, --only, --quick, bad files."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
import xarray as xr
from pydantic import BaseModel

import tripod_doe as td
from started import Process
from tripod_doe.analyses.kinds import makes_kind
from tripod_doe.analyses.registry import ANALYSES, Analysis
from tripod_doe.cli import main
from tripod_doe.files.checksum_list import LIST
from tripod_doe.study.cube.file_digest import is_damaged
from tripod_doe.study.result_directory import open_cube
from tripod_doe.study.result_directory.check import check_files
from tripod_doe.study.result_directory.directory_lock import DirectoryLock
from tripod_doe.workflow.run_workflow import _Chain
from tripod_doe.workflow.steps_file import found_sentences
from tripod_doe.workflow.workflow import load_workflow

pytestmark = pytest.mark.usefixtures("charts_not_drawn")

COUNTED = """
import os, time
def counted(x, slow=0.0, tag=0.0):
    with open(os.environ["COUNT_LOG"], "a") as log:
        log.write(f"{tag} {x}\\n")
    time.sleep(slow)
    if x < 0:
        raise ValueError("x is negative")
    return {"y": x * x}
"""

STUDY = """
[study]
name = "{name}"
function = "counted:counted"
[base]
tag = {tag}
slow = {slow}
[factors.x]
values = [{values}]
[run]
block = 1
"""

CHAIN = """
[workflow]
name = "Chain"
question = "Does it <b>hold</b>?"
[steps.last]
kind = "report"
inputs = ["picture", "first", "second"]
[steps.picture]
kind = "figure"
figure = "effects"
inputs = ["second"]
[steps.second]
kind = "study"
study = "second.toml"
inputs = ["first"]
[steps.first]
kind = "study"
study = "first.toml"
[steps.other]
kind = "study"
study = "other.toml"
[quick.second]
base = {tag = 7}
factors.x = {values = [1, 2]}
"""

ANALYSED = """
[workflow]
name = "Analysed"
[steps.first]
kind = "study"
study = "first.toml"
[steps.highest]
kind = "highest"
inputs = ["first"]
"""


class Bench:
    """A folder with counted studies and a workflow over them."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.log, self.out = folder, folder / "log", folder / "out"
        (folder / "counted.py").write_text(COUNTED)
        for tag, name in enumerate(("first", "second", "other")):
            self.study(name, tag=tag)
        self.write(CHAIN)

    def study(self, name: str, values: str = "1, 2, 3", tag: int = 0, slow: float = 0.0) -> None:
        (self.folder / f"{name}.toml").write_text(STUDY.format(name=name, values=values, tag=tag, slow=slow))

    def write(self, text: str) -> None:
        (self.folder / "chain.toml").write_text(text)

    def run(self, pages: bool = False, **options) -> dict[str, str]:
        """States of the steps; without the pages of the studies, which take most of the time."""
        with pytest.MonkeyPatch.context() as patch:
            if not pages:
                patch.setattr("tripod_doe.workflow.run_study.write_report", lambda directory, findings: None)
            summary = td.run_workflow(self.folder / "chain.toml", self.out, workers=0, progress=False, **options)
        self.steps = {step.name: step for step in summary.steps}
        self.summary = summary
        return {step.name: step.state for step in summary.steps}

    def calls(self) -> list[tuple[float, float]]:
        """Points that were run since the last time, (tag, x)."""
        lines = self.log.read_text().splitlines() if self.log.exists() else []
        self.log.unlink(missing_ok=True)
        return [(float(line.split()[0]), float(line.split()[1])) for line in lines]


@pytest.fixture
def bench(tmp_path, monkeypatch):
    monkeypatch.setenv("COUNT_LOG", str(tmp_path / "log"))
    monkeypatch.delitem(sys.modules, "counted", raising=False)
    return Bench(tmp_path)


def test_steps_run_after_what_they_need_and_once(bench):
    assert set(bench.run(pages=True).values()) == {"finished"}
    assert bench.summary.good
    order = [tag for tag, _ in bench.calls()]
    assert sorted(order) == [0, 0, 0, 1, 1, 1, 2, 2, 2]
    assert max(i for i, tag in enumerate(order) if tag == 0) < min(i for i, tag in enumerate(order) if tag == 1)
    assert set(bench.run().values()) == {"reused"}
    assert bench.calls() == []
    cube = td.open_cube(bench.out / "steps" / "second")
    assert cube["y"].values.tolist() == [1, 4, 9]
    page = bench.summary.page.read_text()
    assert bench.summary.page == bench.out / "report" / "index.html"
    assert "Does it &lt;b&gt;hold" in page
    assert "Quick run" not in page
    for name in ("first", "second", "other"):
        assert f'href="../steps/{name}/report/index.html"' in page
        assert (bench.out / "report" / f"../steps/{name}/report/index.html").exists()
    report = (bench.out / "steps" / "last" / "index.html").read_text()
    assert "<svg" in report
    assert 'href="../first/report/index.html"' in report


def test_its_surrogate_is_asked_what_if(bench, capsys):
    """Regression: only a surrogate of a study was asked, and the directory of a workflow was one of a study."""
    bench.study("first", ", ".join(map(str, range(1, 25))))
    bench.write(ANALYSED.replace("highest", "surrogate"))
    assert set(bench.run().values()) == {"finished"}
    place = bench.out / "steps" / "surrogate"
    assert main(["report", str(place), "--format", "what-if"]) == 0
    page = (place / "report" / "what_if.html").read_text()
    assert "Surrogate of first" in page
    assert "<script" in page
    assert main(["check", str(bench.out)]) == 0
    for words in ([], ["--format", "what-if"]):
        capsys.readouterr()
        assert main(["report", str(bench.out), *words]) == 2
        assert "the directory of a workflow: tripod-doe workflow writes its page" in capsys.readouterr().err


def test_a_step_of_another_workflow_is_refused_and_made_again(bench, monkeypatch):
    """Regression: copied with its record it was taken for a step of this one, in silence."""

    @makes_kind("highest")
    def highest(cubes, settings, folder):
        return cubes["first"][["y"]].max()

    monkeypatch.setitem(ANALYSES, "highest", Analysis(highest, type("Settings", (BaseModel,), {})))
    bench.write(ANALYSED)
    bench.run()
    other = shutil.copytree(bench.out, bench.folder / "other")
    shutil.rmtree(bench.out)
    bench.study("first", "1, 2, 4")
    bench.run()
    shutil.copytree(other / "steps" / "highest", bench.out / "steps" / "highest", dirs_exist_ok=True)
    with pytest.raises(td.CubeError, match="files of another directory were copied here"):
        td.open_cube(bench.out / "steps" / "highest")
    damaged = {file.path for file in check_files(bench.out) if not file.is_whole}
    assert {bench.out / "steps" / "highest" / name for name in (LIST, "cube.nc")} <= damaged
    assert bench.run() == {"first": "reused", "highest": "finished"}
    assert all(file.is_whole for file in check_files(bench.out))


def test_what_a_study_of_it_looks_for_is_said(bench):
    """Exact: of 1, 4 and 9 one is above 5; so it is when the step is reused, and in a quick run of 1 and 2."""
    bench.study("second", "1, 2, 3", tag=1)
    with (bench.folder / "second.toml").open("a") as file:
        file.write('look_for = "y > 5"\n')
    for state in ("finished", "reused"):
        assert bench.run(only="second")["second"] == state
        assert found_sentences(bench.out) == "second: 1 of 3 points meets y > 5; the first at x = 3."
        assert bench.steps["second"].detail.startswith("3 points; 1 of 3 points meets y > 5")
    bench.run(only="second", quick=True)
    assert found_sentences(bench.out) == "second: No point meets y > 5."


@pytest.mark.slow
def test_only_what_changed_and_what_needs_it_runs_again(bench):
    bench.run()
    bench.calls()
    bench.study("second", "1, 2, 3, 4", tag=1)  # it grew: its old points are kept
    assert bench.run() == {
        "first": "reused",
        "other": "reused",
        "second": "finished",
        "picture": "finished",
        "last": "finished",
    }
    assert bench.calls() == [(1, 4)]
    (bench.out / "steps" / "picture" / "figures.json").unlink()  # a result that went missing is made again
    states = bench.run()
    assert (states["picture"], states["second"]) == ("finished", "reused")
    cube = bench.out / "steps" / "first" / "cube.nc"
    content = bytearray(cube.read_bytes())
    content[len(content) // 2] ^= 4
    cube.write_bytes(content)
    states = bench.run()  # so is one that was damaged
    assert (states["first"], states["second"]) == ("finished", "reused")
    assert bench.calls() == []
    assert not is_damaged(cube)


@pytest.mark.slow
def test_a_page_is_made_again_when_the_question_or_the_notice_on_it_changes(bench):
    """Regression: pages of report steps kept the question that the workflow had when they were made."""

    def hashes(text: str, quick: bool) -> dict[str, str]:
        bench.write(text)
        return {name: step.hash for name, step in load_workflow(bench.folder / "chain.toml", quick).steps.items()}

    chain = CHAIN + "[quick.other]\nfactors.x = {values = [1]}\n"
    for changed, quick in ((chain.replace("hold", "last"), False), (chain.replace("[1]", "[1, 2]"), True)):
        before, after = hashes(chain, quick), hashes(changed, quick)
        assert {name for name in after if after[name] != before[name]} == {"last"} | ({"other"} if quick else set())


def test_a_failed_step_stops_only_what_needs_it(bench):
    bench.study("first", "1, -1", tag=0)
    assert bench.run() == {
        "first": "failed",
        "second": "blocked",
        "picture": "blocked",
        "last": "blocked",
        "other": "finished",
    }
    assert not bench.summary.good
    assert bench.steps["first"].detail.startswith("1 point ended as error: ")
    assert bench.steps["second"].detail == "needs first"
    assert {tag for tag, _ in bench.calls()} == {0, 2}
    assert main(["workflow", str(bench.folder / "chain.toml"), "--out", str(bench.out)]) == 3
    assert bench.calls() == []  # the failed point stands in the journal
    assert main(["workflow", str(bench.folder / "chain.toml"), "--out", str(bench.out), "--retry-failed"]) == 3
    assert bench.calls() == [(0, -1)]


def test_a_study_that_changed_under_its_results_fails_and_says_what_to_do(bench):
    bench.run()
    bench.study("other", "4, 5", tag=2)
    assert bench.run()["other"] == "failed"
    assert "choose another out" in bench.steps["other"].detail


def test_only_runs_a_step_and_what_it_needs(bench):
    states = bench.run(only="second")
    assert states == {
        "first": "finished",
        "second": "finished",
        "other": "not selected",
        "picture": "not selected",
        "last": "not selected",
    }
    assert bench.summary.good
    assert {tag for tag, _ in bench.calls()} == {0, 1}
    assert bench.run(only="other")["second"] == "reused"
    stored = bench.out / "steps" / "second" / "study.toml"
    text = stored.read_text()
    stored.write_text(text.replace("second", "sec"))  # Regression: reused, its points could not be read any more
    assert bench.run(only="second")["second"] == "finished"
    assert stored.read_text() == text
    journal = stored.with_name("journal.sqlite")
    content = bytearray(journal.read_bytes())
    content[content.index(b"outputs")] ^= 4
    journal.write_bytes(content)
    assert bench.run(only="second")["second"] == "finished"
    assert all(checked.is_whole for checked in check_files(stored.parent))
    with pytest.raises(td.InputError, match=r"only='secnd': no such step.*did you mean 'second'"):
        bench.run(only="secnd")


@pytest.mark.slow
def test_quick_overrides_studies_and_says_so(bench):
    assert set(bench.run(quick=True).values()) == {"finished"}
    assert sorted(bench.calls()) == [(0, 1), (0, 2), (0, 3), (2, 1), (2, 2), (2, 3), (7, 1), (7, 2)]
    cube = td.open_cube(bench.out / "quick" / "second")
    assert cube.attrs["title"] == "second (quick)"
    assert cube["y"].values.tolist() == [1, 4]
    assert "Quick run: smaller studies, whose numbers are not results" in bench.summary.page.read_text()
    assert "Quick run" in (bench.out / "quick" / "last" / "index.html").read_text()
    assert set(bench.run().values()) == {"finished"}  # a quick step never stands for the real one
    assert len(bench.calls()) == 9


@pytest.mark.slow
def test_a_kill_loses_no_finished_point_and_no_finished_step(bench):
    for tag, name in enumerate(("first", "second", "other")):
        bench.study(name, ", ".join(map(str, range(40))), tag=tag, slow=0.03)
    command = ["-m", "tripod_doe.cli", "workflow", str(bench.folder / "chain.toml"), "--workers", "0"]
    process = Process([*command, "--out", str(bench.out), "--only", "second"])
    while not bench.log.exists() or len(bench.log.read_text().splitlines()) < 55:
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    before = bench.calls()
    states = bench.run(only="second")
    assert (states["first"], states["second"]) == ("reused", "finished")
    after = bench.calls()
    assert not [call for call in after if call[0] == 0], "a finished step ran again"
    lost = set(before) & set(after)
    assert len(lost) <= 1, "only the block at work may run again"
    assert sorted(set(before) | set(after)) == sorted((tag, x) for tag in (0, 1) for x in range(40))


@pytest.mark.slow
def test_an_interrupt_ends_with_130_and_keeps_what_is_finished(bench):
    bench.study("first", ", ".join(map(str, range(80))), slow=0.05)
    command = ["-m", "tripod_doe.cli", "workflow", str(bench.folder / "chain.toml"), "--workers", "1"]
    process = Process([*command, "--out", str(bench.out), "--only", "first"])
    while not bench.log.exists() or len(bench.log.read_text().splitlines()) < 5:
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, message = process.communicate(timeout=60)
    assert process.returncode == 130, message
    assert "interrupted; finished points are kept" in message
    bench.calls()
    bench.run(only="first")
    assert len(bench.calls()) <= 78


class Settings(BaseModel):
    model_config = {"extra": "forbid"}
    most: float


def test_python_steps_come_through_the_registry(bench, monkeypatch):
    @makes_kind("limits")
    def limits(cubes, settings, folder):
        worst = max(float(cube["y"].max()) for cube in cubes.values())
        return xr.Dataset({"holds": ("claim", [int(worst <= settings.most)])}, coords={"claim": ["small"]})

    monkeypatch.setitem(ANALYSES, "limits", Analysis(limits, Settings))
    step = '[steps.checks]\nkind = "limits"\ninputs = ["first", "other"]\nsettings = {most = 9}\n'
    bench.write(CHAIN + step)
    assert bench.run(only="checks")["checks"] == "finished"
    assert td.open_cube(bench.out / "steps" / "checks")["holds"].values.tolist() == [1]
    assert td.query(bench.out / "steps" / "checks", "holds")["holds"].sizes == {"claim": 1}
    bench.write(CHAIN + step.replace("most", "moist"))
    with pytest.raises(td.InputError, match=r"\[steps.checks\]: settings: unknown key 'moist'; did you mean 'most'"):
        bench.run()


def test_steps_read_of_large_cubes_what_they_use(bench, monkeypatch):
    """Cubes of any size count as large here; they were read whole before."""
    monkeypatch.setattr(open_cube, "_READ_AT_ONCE", 0)
    in_memory = []

    @makes_kind("largest")
    def largest(cubes, settings, folder):
        in_memory.extend(cube["y"].variable._in_memory for cube in cubes.values())
        return xr.Dataset({"largest": cubes["first"]["y"].max()})

    monkeypatch.setitem(ANALYSES, "largest", Analysis(largest, Settings))
    bench.write(CHAIN + '[steps.top]\nkind = "largest"\ninputs = ["first", "other"]\nsettings = {most = 9}\n')
    assert set(bench.run().values()) == {"finished"}
    assert in_memory == [False, False]
    assert td.open_cube(bench.out / "steps" / "top")["largest"] == 9
    open_files = [Path(file.path) for file in psutil.Process().open_files()]
    assert not [file for file in open_files if file.is_relative_to(bench.out.resolve())]


def test_the_page_of_a_blocked_step_is_not_named(bench):
    """Regression: the page of an earlier run stood as "report" at the end, though its step waits for one that failed."""
    bench.run()
    page = bench.out / "steps" / "last" / "index.html"
    assert bench.summary.reports == (page,)
    bench.study("second", tag=5)
    assert bench.run()["last"] == "blocked"
    assert page.is_file()
    assert bench.summary.reports == ()
    bench.study("second", tag=1)
    assert bench.run(only="other")["last"] == "reused"
    assert bench.summary.reports == (page,)


@pytest.mark.slow
def test_a_comparison_is_a_step(tmp_path):
    (tmp_path / "s.toml").write_text('[study]\nname = "s"\n[factors.joint_angle_deg]\nvalues = [5, 10]\n')
    thrust = td.simulate(joint_angle_deg=10)["thrust"].values
    table = np.column_stack([np.arange(720), thrust])
    np.savetxt(tmp_path / "m.csv", table, delimiter=",", header="rotation_deg,thrust_n", comments="")
    (tmp_path / "w.toml").write_text(
        '[workflow]\nname = "w"\n[steps.s]\nkind = "study"\nstudy = "s.toml"\n'
        '[steps.c]\nkind = "comparison"\ninputs = ["s"]\n'
        'settings = {measurement = "m.csv", select = ["joint_angle_deg=10"], reference_angle_deg = 0}\n'
        '[steps.f]\nkind = "figure"\nfigure = "comparison"\ninputs = ["c"]\n'
        '[steps.r]\nkind = "report"\ninputs = ["c", "f"]\n'
    )
    summary = td.run_workflow(tmp_path / "w.toml", tmp_path / "out", progress=False)
    assert summary.good, summary.steps
    assert "The measured third order" in (tmp_path / "out" / "steps" / "r" / "index.html").read_text()
    (tmp_path / "m.csv").write_text("rotation_deg,thrust_n\n1,2\n")  # the file is one of the step's inputs
    again = td.run_workflow(tmp_path / "w.toml", tmp_path / "out", progress=False)
    assert [step.state for step in again.steps] == ["reused", "failed", "blocked", "blocked"]


STEP = '[workflow]\nname = "w"\n[steps.a]\nkind = "study"\nstudy = "first.toml"\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[workflow", "chain.toml: not valid TOML"),
        ("[steps.a]\nkind='study'\nstudy='first.toml'\n", r"chain.toml: the file: table \[workflow\] is missing"),
        ('[workflow]\nname = "w"\n', r"table \[steps\] is missing"),
        (STEP + "[worklow]\n", "unknown key 'worklow'; did you mean 'workflow'"),
        (STEP + 'stdy = "x"\n', r"\[steps.a\]: unknown key 'stdy'; did you mean 'study'"),
        (STEP.replace('study"\nst', 'stduy"\nst'), r"\[steps.a\]: kind = 'stduy': unknown; did you mean 'study'"),
        (STEP.replace('kind = "study"\n', ""), r"\[steps.a\]: kind is missing"),
        (STEP.replace("first.toml", "frist.toml"), r"\[steps.a\]: .*frist.toml: cannot read the study file"),
        (STEP + 'inputs = ["b"]\n', r"\[steps.a\]: inputs: no step 'b'"),
        (STEP + 'inputs = ["a"]\n', r"circular inputs: a -> a; remove one of them"),
        (
            STEP + "base = {tga = 1}\n",
            r"\[steps.a\]: .*first.toml: \[base\]: tga = 1: unknown parameter; did you mean 'tag'",
        ),
        (STEP + "factors.z = {values = [1]}\n", "factors.z: this study does not vary it"),
        (STEP + "factors.x = {valeus = [1]}\n", r"unknown key 'valeus'; did you mean 'values'"),
        (STEP + "[quick.b]\nbase = {tag = 1}\n", r"\[quick.b\]: no study step of this name; allowed: a"),
        (STEP + "[quick.a]\nbse = {tag = 1}\n", r"\[quick.a\]: unknown key 'bse'; did you mean 'base'"),
        (STEP + '[steps.f]\nkind = "figure"\nfigure = "wave"\ninputs = ["a"]\n', "figure = 'wave': unknown"),
        (STEP + '[steps.f]\nkind = "figure"\nfigure = "effects"\n', r"\[steps.f\]: inputs is missing"),
        (
            STEP + '[steps.s]\nkind = "sobol"\ninputs = ["a"]\n',
            "sobol needs a design of kind saltelli; this study's is grid",
        ),
        (STEP + '[steps.s]\nkind = "analysis"\nanalysis = "sobl"\ninputs = ["a"]\n', "did you mean 'sobol'"),
        (
            STEP + '[steps.t]\nkind = "tolerance"\ninputs = ["a"]\nsettings = {confirm = 64}\n',
            r"\[steps.t\]: settings: confirm: a step runs no other points; put .*first.toml, as \[analysis.tolerance\]",
        ),
        (STEP + '[steps.c]\nkind = "comparison"\ninputs = ["a"]\n', r"\[steps.c\]: settings: measurement is missing"),
        (
            STEP + '[steps.c]\nkind = "comparison"\ninputs = ["a"]\nsettings = {measurement = "no.csv"}\n',
            r"\[steps.c\]: settings: measurement: cannot read .*no.csv",
        ),
        (
            STEP + '[steps.f]\nkind = "figure"\nfigure = "effects"\ninputs = ["a"]\n'
            '[steps.g]\nkind = "figure"\nfigure = "effects"\ninputs = ["f"]\n',
            r"\[steps.g\]: inputs: 'f' is a figure and has no cube",
        ),
        (
            STEP + '[steps.e]\nkind = "effects"\ninputs = ["a"]\n'
            '[steps.f]\nkind = "figure"\nfigure = "effects"\ninputs = ["e"]\n',
            r"\[steps.f\]: inputs: the figure effects shows one study step, not e",
        ),
        (
            STEP
            + STEP[STEP.index("[steps.a]") :].replace("steps.a", "steps.b")
            + '[steps.f]\nkind = "figure"\nfigure = "effects"\ninputs = ["a", "b"]\n',
            r"\[steps.f\]: inputs: the figure effects shows one study step, not a, b",
        ),
        (
            STEP + '[steps.f]\nkind = "figure"\nfigure = "indices"\ninputs = ["a"]\n',
            r"\[steps.f\]: inputs: the figure indices shows a step of kind sobol or .* or multifidelity; a is none",
        ),
        (STEP.replace("steps.a", 'steps."a/b"'), "use letters a to z, digits"),
    ],
)
def test_a_bad_file_is_refused_and_starts_nothing(bench, capsys, text, message):
    bench.write(text)
    with pytest.raises(td.InputError, match=f"(?s){message}"):
        bench.run(quick=True)
    assert main(["workflow", str(bench.folder / "chain.toml"), "--out", str(bench.out), "--quick"]) == 2
    assert "Traceback" not in capsys.readouterr().err
    assert not bench.out.exists()


def test_bad_calls_are_refused(bench, capsys):
    chain = str(bench.folder / "chain.toml")
    for words, message in [
        (["nowhere.toml", "--out", "x"], "cannot read the workflow file"),
        ([chain, "--out", str(bench.out), "--workers", "-1"], "must be 0 (this process) or more"),
        ([chain, "--out", "/proc/nowhere"], "cannot make this directory"),
        ([chain], "--out"),
        ([chain, "--out", "x", "--quik"], "did you mean '--quick'"),
    ]:
        assert main(["workflow", *words]) == 2
        assert message in capsys.readouterr().err


def test_the_example_is_sound_and_the_schema_describes_every_key(capsys):
    example = Path(__file__).parents[2] / "workflows" / "small.toml"
    steps = load_workflow(example, quick=True).steps
    assert list(steps).index("indices") > list(steps).index("friction")
    assert steps["map"].study.file.factors["joint_angle_deg"].values == [5, 10]
    assert load_workflow(example).steps["map"].hash != steps["map"].hash
    assert main(["schema", "workflow"]) == 0
    schema = json.loads(capsys.readouterr().out)
    kinds = {"StudyStep", "AnalysisStep", "FigureStep", "ReportStep"}
    assert {
        entry["$ref"].split("/")[-1] for entry in schema["properties"]["steps"]["additionalProperties"]["anyOf"]
    } == kinds
    for name, table in schema["$defs"].items():
        for key, entry in table["properties"].items():
            assert entry.get("description"), f"{name}.{key}"
    assert set(schema["x-settings"]) == set(ANALYSES)


def test_pages_of_workflows_and_their_reports_hold_question_and_answer(bench):
    """Regression: a workflow without claims had an empty answer, and its report pages no question."""
    bench.write(CHAIN)
    bench.run()
    pages = [bench.out / "report" / "index.html", bench.out / "steps" / "last" / "index.html"]
    for text in (page.read_text(encoding="utf-8") for page in pages):
        assert "Does it &lt;b&gt;hold&lt;/b&gt;?" in text
        assert re.search(r"<h2>Answer</h2>\s*<p>\S", text)


@pytest.mark.parametrize(
    ("changed", "kinds"),
    [
        ("analyses/sensitivity/sobol.py", {"analysis", "figure", "report"}),
        ("measurements/measurement.py", {"analysis", "figure", "report"}),
        ("page_parts/page.html", {"figure", "report"}),
        ("reports/study_report.py", {"figure", "report"}),
    ],
)
def test_steps_are_made_again_when_the_code_that_makes_them_changes(tmp_path, monkeypatch, changed, kinds):
    """The package is copied, so that one of its files can change."""
    example = Path(__file__).parents[2] / "workflows" / "small.toml"
    package = tmp_path / "tripod_doe"
    shutil.copytree(Path(td.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(td, "__file__", str(package / "__init__.py"))
    before = load_workflow(example).steps
    assert (package / changed).exists()
    (package / changed).write_text((package / changed).read_text() + "\n# another version\n")
    after = load_workflow(example).steps
    assert {step.table.kind for name, step in after.items() if step.hash != before[name].hash} == kinds


DOUBLED = '[responses.twice]\nformula = "2 * y"\n'


class Doubled:
    """A workflow with the largest response of its first study, 18 of 2, 8 and 18."""

    def __init__(self, bench: Bench, monkeypatch) -> None:
        self.bench, self.points = bench, bench.out / "steps" / "first"
        monkeypatch.setattr("tripod_doe.workflow.run_study.write_report", lambda directory, findings: None)
        monkeypatch.setitem(ANALYSES, "highest", Analysis(self.highest, Settings))
        self.study()
        assert self.run() == ({"first": "finished", "highest": "finished"}, 18.0)
        bench.calls()

    @staticmethod
    @makes_kind("highest")
    def highest(cubes, settings, folder):
        return cubes["first"][["twice"]].max()

    def study(self, values: str = "1, 2, 3", added: str = "") -> Path:
        self.bench.study("first", values)
        path = self.bench.folder / "first.toml"
        path.write_text(path.read_text() + DOUBLED + added)
        return path

    def run(self, most: int = 0) -> tuple[dict[str, str], float]:
        """States of the steps, and the result; other settings let the analysis run again."""
        self.bench.write(ANALYSED + f"settings = {{most = {most}}}\n")
        states = self.bench.run()
        made = states["highest"] in ("finished", "reused")
        return states, float(td.open_cube(self.bench.out / "steps" / "highest")["twice"]) if made else np.nan

    def derive(self, name: str, formula: str) -> None:
        (self.bench.folder / "more.toml").write_text(f'[responses.{name}]\nformula = "{formula}"\n')
        td.derive(self.points, self.bench.folder / "more.toml")


@pytest.fixture
def doubled(bench, monkeypatch):
    return Doubled(bench, monkeypatch)


def test_a_step_whose_formula_was_replaced_is_made_again(doubled):
    """Regression: the step was reused, and the next one computed from the other formula in silence."""
    doubled.derive("twice", "0.001 * y")
    doubled.derive("more", "y + 1")
    assert doubled.run(most=1) == ({"first": "finished", "highest": "finished"}, 18.0)
    assert td.open_cube(doubled.points)["more"].values.tolist() == [2, 5, 10]  # a new name is kept
    assert doubled.bench.calls() == []
    assert doubled.run(most=1) == ({"first": "reused", "highest": "reused"}, 18.0)


def test_a_step_whose_study_grew_under_it_fails(doubled):
    """Regression: the step was reused, and the next one computed from all points in silence."""
    larger = doubled.study("1, 2, 3, 9")
    td.run(larger, doubled.points, workers=0, progress=False)
    doubled.study()
    states, _ = doubled.run(most=1)
    assert states == {"first": "failed", "highest": "blocked"}
    assert "factors.x.values: [1, 2, 3, 9] -> [1, 2, 3]" in doubled.bench.steps["first"].detail
    doubled.study("1, 2, 3, 9")
    assert doubled.run(most=1) == ({"first": "finished", "highest": "finished"}, 162.0)


@pytest.mark.parametrize("when", ["before", "within"])
def test_results_that_another_command_changes_while_a_workflow_runs_are_refused(doubled, monkeypatch, when):
    """Regression: the analysis computed from what `derive` wrote between two steps in silence."""
    analyse = ANALYSES["highest"].function

    @makes_kind("highest")
    def late(cubes, settings, folder):
        result = analyse(cubes, settings, folder)
        doubled.derive("twice", "0.001 * y")
        return result

    if when == "within":
        monkeypatch.setitem(ANALYSES, "highest", Analysis(late, Settings))
    else:
        report = _Chain._report_state

        def reported(chain, view):
            if view.name == "first":
                doubled.derive("twice", "0.001 * y")
            return report(chain, view)

        monkeypatch.setattr(_Chain, "_report_state", reported)
    with pytest.raises(td.InputError, match="first: another command changed these results while the workflow ran"):
        doubled.run(most=1)
    monkeypatch.undo()


def test_one_process_at_a_time_runs_a_workflow_in_a_directory(doubled):
    """Regression: a second workflow changed the steps that the first one was about to read."""
    lock = DirectoryLock(doubled.bench.out)
    with pytest.raises(td.InputError, match=r"out: process \d+ on .* is writing here; wait for it"):
        doubled.run(most=1)
    lock.release()
    assert doubled.run(most=1)[1] == 18.0
    DirectoryLock(doubled.bench.out).release()
