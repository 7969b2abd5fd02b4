"""Results that are exchanged in the folder of a server: links to the former ones lead nowhere, at once."""

from __future__ import annotations

import shutil

import pytest

from tripod_doe.service.problems import RefusedError
from tripod_doe.service.requests.uploads import UPLOAD
from tripod_doe.service.runs.found_directories import FoundDirectories
from tripod_doe.service.runs.run_table import State
from tripod_doe.service.service import Service
from tripod_doe.service.settings import Settings
from tripod_doe.study.definition.study_folder import table_copy
from tripod_doe.study.journal import Journal
from tripod_doe.study.result_directory.annotation import Annotation, write_annotation
from tripod_doe.study.result_directory.directory_lock import DirectoryLock
from tripod_doe.workflow.steps_file import write_steps

PLAN = {"kind": "study", "name": "shared", "question": "", "unique": 3, "expected_outcomes": []}


def filled(path):
    path.mkdir()
    (path / "study.toml").write_text("[study]\n")
    Journal(path).close()
    return path


@pytest.fixture
def service(tmp_path):
    (tmp_path / "runs").mkdir()
    service = Service(Settings(tmp_path / "runs", workers=0))
    yield service
    service.runs._table.close()


@pytest.fixture
def look(service):
    """Look once for directories of the command line."""
    return FoundDirectories(service.settings.folder, service.runs, lambda path: PLAN)._look


def at_work(service, tmp_path, kind="study"):
    """A run of the service whose process has just written its first file."""
    upload = tmp_path / "upload"
    upload.mkdir()
    steps = {} if kind == "study" else {"steps": {}}
    run = service.runs._store(service.runs.submit(upload, PLAN | {"kind": kind} | steps).changed(state=State.RUNNING))
    place = service.directory(run.id)
    begun(place, kind)
    service.runs._look_at(run.id)
    return run.id, place


def begun(place, kind):
    """Write what a run writes first."""
    if kind == "study":
        Journal(place).close()
    else:
        write_steps(place, [])


def refused(service, run_id):
    with pytest.raises(RefusedError) as error:
        service.directory(run_id)
    return error.value.status


@pytest.mark.parametrize("running", [False, True])
def test_a_found_run_is_known_by_its_results_at_each_answer(service, look, tmp_path, running):
    """Regression: while it ran, and until the next look, its link opened what had taken its place."""
    place = filled(tmp_path / "runs" / "shared")
    secret = filled(tmp_path / "secret")
    lock = DirectoryLock(place) if running else None
    look()
    (run,) = service.runs.all()
    assert run.state.alive == running
    assert service.directory(run.id) == place
    place.rename(tmp_path / "away")
    secret.rename(place)
    assert refused(service, run.id) == 404
    look()
    (other,) = service.runs.all()
    assert other.id != run.id
    assert service.directory(other.id) == place
    if lock:
        lock.release()


def test_results_that_get_the_inode_of_deleted_ones_are_others(service, look, tmp_path, monkeypatch):
    place = filled(tmp_path / "runs" / "shared")
    look()
    (run,) = service.runs.all()
    shutil.rmtree(place)
    filled(place)
    inode = (place / "journal.sqlite").stat().st_ino
    service.runs._runs[run.id] = run.changed(inode=inode)
    assert refused(service, run.id) == 404


@pytest.mark.parametrize("kind", ["study", "workflow", "fit", "optimisation"])
def test_a_run_of_the_service_is_known_by_its_results(service, tmp_path, kind):
    """Regression: it was known by its directory's name alone; a workflow or a search still was."""
    run_id, place = at_work(service, tmp_path, kind)
    assert service.runs.find(run_id).state is State.FAILED
    assert service.directory(run_id) == place
    place.rename(tmp_path / "away")
    shutil.copytree(tmp_path / "away", place)  # as in a copy of the whole folder
    assert service.directory(run_id) == place
    shutil.rmtree(place)
    place.mkdir()
    begun(place, kind)
    assert refused(service, run_id) == 404
    with pytest.raises(RefusedError, match="the results of another run"):
        service.runs.resume(run_id)


@pytest.mark.parametrize("kind", ["study", "workflow"])
def test_a_run_that_goes_on_keeps_its_results(service, tmp_path, monkeypatch, kind):
    """Regression: from the resume until its next look it took any results in its directory for its own."""
    monkeypatch.setattr("tripod_doe.service.runs.processes.start_run", lambda *arguments: None)
    run_id, place = at_work(service, tmp_path, kind)
    service.runs.resume(run_id)
    service.runs._start(run_id)
    assert service.runs.find(run_id).state is State.RUNNING
    assert service.directory(run_id) == place
    shutil.rmtree(place)
    place.mkdir()
    begun(place, kind)
    assert refused(service, run_id) == 404


@pytest.mark.parametrize("kind", ["study", "workflow"])
def test_a_run_that_died_before_its_results_goes_on_with_those_of_the_command_line(
    service, tmp_path, monkeypatch, kind
):
    """Regression: resumed, it failed for ever, as its directory held the results of another run."""
    monkeypatch.setattr("tripod_doe.service.runs.processes.start_run", lambda *arguments: None)
    (tmp_path / "upload").mkdir()
    plan = PLAN | {"kind": kind} | ({} if kind == "study" else {"steps": {}})
    run = service.runs._store(service.runs.submit(tmp_path / "upload", plan).changed(state=State.FAILED))
    begun(service.directory(run.id), kind)
    service.runs.resume(run.id)
    service.runs._start(run.id)
    assert service.runs.find(run.id).state is State.RUNNING


@pytest.mark.parametrize("kind", ["study", "workflow", "fit", "optimisation"])
def test_a_run_that_was_stopped_before_its_results_goes_on_with_those_of_the_command_line(service, tmp_path, kind):
    """Regression: its results, made by hand from its own upload, were those of another run, and it was not resumed."""
    (tmp_path / "upload").mkdir()
    (tmp_path / "upload" / f"{kind}.toml").write_text(f"[{kind}]\n")
    plan = PLAN | {"kind": kind, "steps": {"map": {}}}
    run_id = service.runs.submit(tmp_path / "upload", plan).id
    service.runs.stop(run_id)
    place = service.directory(run_id)
    own = {"study": "study.toml", "fit": "fit.toml", "optimisation": "optimise.toml"}.get(kind)
    if own:
        (place / own).write_text("[other]\n")
    begun(place, kind)
    if kind == "workflow":
        write_steps(place, [{"name": "other"}])
    assert refused(service, run_id) == 404
    if own:
        (place / own).write_text(f"[{kind}]\n")
    else:
        write_steps(place, [{"name": "map"}])
    assert service.runs.resume(run_id).state is State.QUEUED


def test_a_run_that_was_stopped_before_its_start_takes_a_larger_study(service, tmp_path):
    """Regression: the price of that study left a journal, so that the run was not found any more, and never ran."""
    (tmp_path / "upload").mkdir()
    (tmp_path / "upload" / "study.toml").write_text("[study]\n")
    run_id = service.runs.submit(tmp_path / "upload", PLAN).id
    service.runs.stop(run_id)
    begun(service.directory(run_id), "study")  # as ResultDirectory, of which the price asks what is missing
    assert service.runs.resume(run_id).state is State.QUEUED


def test_an_upload_that_a_kill_left_aside_is_put_back_and_one_that_is_gone_is_said(service, tmp_path):
    """Regression: an internal error, and a run that was never resumed."""
    (tmp_path / "upload").mkdir()
    run_id = service.runs.submit(tmp_path / "upload", PLAN).id
    place = service.directory(run_id)
    for content in (None, b"\xff"):
        if content:
            (place / UPLOAD / "study.toml").write_bytes(content)
        with pytest.raises(RefusedError, match=r"404.*gone or damaged"):
            service.upload_of(run_id)
    (place / UPLOAD / "study.toml").write_text("[study]\n")
    (place / UPLOAD).rename(place / f".{UPLOAD}.old")
    with pytest.raises(RefusedError, match=r"404.*gone or damaged"):
        service.upload_of(run_id)
    service._tidy()
    assert service.upload_of(run_id) == {"study": "[study]\n", "files": {}}


def test_no_note_is_written_beside_or_read_from_the_results_of_another_run(service, tmp_path):
    """Regression: the name for a run went into the directory that had taken its place, and its note to the link."""
    run_id, place = at_work(service, tmp_path)
    shutil.rmtree(place)
    place.mkdir()
    begun(place, "study")
    with pytest.raises(RefusedError, match="the results of another run"):
        service.runs.annotate(run_id, {"note": "mine"})
    assert [path.name for path in place.iterdir()] == ["journal.sqlite"]
    write_annotation(place, Annotation(note="private"))
    service.runs._read_annotations()
    assert not service.runs.find(run_id).note


def test_a_run_whose_table_alone_the_command_line_exchanged_is_shown_anew(service, look, tmp_path):
    """Regression: the list kept the counts of the table that was submitted."""
    upload = tmp_path / "upload"
    upload.mkdir()
    (upload / "study.toml").write_text("[study]\n")
    (upload / "points.csv").write_text("x\n1\n")
    run = service.runs._store(service.runs.submit(upload, PLAN).changed(state=State.FINISHED))
    place = service.directory(run.id)
    assert (place / UPLOAD / "points.csv").is_file()
    (place / "study.toml").write_text("[study]\n")
    Journal(place).close()
    copy = table_copy(place, "points.csv")
    copy.parent.mkdir()
    copy.write_text("x\n1\n")
    look()
    assert not service.runs.find(run.id).place
    copy.write_text("x\n1\n2\n")
    (place / "cube.nc").touch()
    look()
    assert service.runs.find(run.id).place == run.id


def test_a_run_whose_pilot_has_decided_its_samples_stays_a_run_of_the_service(service, look, tmp_path):
    """Regression: once its report was made again or its folder copied, it was one of the command line."""
    upload = tmp_path / "upload"
    upload.mkdir()
    design = '[study]\n[design]\nkind = "multifidelity"\nsamples = 20\n'
    (upload / "study.toml").write_text(design)
    run = service.runs._store(service.runs.submit(upload, PLAN).changed(state=State.FINISHED))
    place = service.directory(run.id)
    (place / "study.toml").write_text(f"{design}split = {{ equilibrium = 90 }}\nprices = {{ equilibrium = 0.1 }}\n")
    Journal(place).close()
    look()
    assert not service.runs.find(run.id).place
    (place / "study.toml").write_text(design.replace("20", "30"))
    look()
    assert service.runs.find(run.id).place == run.id
