"""Answers of workers to questions: functions that call what the command line calls, so the numbers are the same."""

import hashlib
import json
import re
import tempfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tripod_doe.errors import InputError, TooLargeError, option
from tripod_doe.service.limits import Limits
from tripod_doe.service.problems import RefusedError, problems_of, refusal_of
from tripod_doe.service.requests.bodies import read_form, read_json
from tripod_doe.service.requests.forms import Derivation, ExtensionPlan, PlanRequest, RunChange, Submission
from tripod_doe.service.requests.uploads import (
    KINDS,
    STUDY,
    UPLOAD,
    main_file,
    refuse_large_texts,
    refuse_many_files,
    upload_texts,
    write_upload,
)
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.definition.toml_text import read_text

_MOST_AT_ONCE = 50_000  # cells of a small query: 4 MB of JSON
_SAMPLE = 1_000  # rows from which the size of an answer is estimated


def plan(body: bytes, limits: Limits) -> Any:
    """Price of an upload; see `plans`."""
    from tripod_doe.service.requests.plans import plan_upload

    request = read_form(body, PlanRequest, limits.nesting)
    kind, texts = upload_texts(request.model_dump())
    with _pointing_into(texts), tempfile.TemporaryDirectory(prefix="tripod-doe-") as name:
        folder = Path(name) / "upload"
        _write(body, texts, folder, limits)
        with _plain_names(folder):
            return plan_upload(folder, kind, limits, request.timing)


def _write(body: bytes, texts: Mapping[str, str], folder: Path, limits: Limits) -> None:
    """Write the texts of a request into a new folder, if they are within the limits."""
    refuse_large_texts(len(body), texts, limits)
    refuse_many_files(texts, limits)
    write_upload(folder, texts)


def wants_timing(body: bytes, limits: Limits) -> bool:
    """Whether a plan must time points, which takes longer."""
    return read_form(body, PlanRequest, limits.nesting).timing


def check(body: bytes, folder: str, limits: Limits) -> Any:
    """Write an upload into a folder, check it and count its points; return the counts and a hash of the request."""
    request = read_form(body, Submission, limits.nesting).model_dump()
    kind, texts = upload_texts(request)
    with _pointing_into(texts):
        counted = _checked(body, kind, texts, Path(folder), limits)
    return counted, hashlib.sha256(json.dumps(request, sort_keys=True).encode()).hexdigest()


def extend(body: bytes, folder: str, path: str, limits: Limits) -> Any:
    """Check the larger version of a study with results in a directory; refuse any change other than growth."""
    kind, texts = upload_texts(read_form(body, Submission, limits.nesting).model_dump())
    if kind != "study":
        raise RefusedError(409, f"this is a {kind}: a run takes the larger version of its study")
    return _extended(body, texts, Path(folder), path, limits, timing=False)


def derive(body: bytes, folder: str, path: str, texts: Mapping[str, str], limits: Limits) -> Any:
    """Check variables by formula against the results in a directory; write the extended texts into a folder."""
    asked = read_form(body, Derivation, limits.nesting)
    texts = _with_responses(texts, asked.responses, asked.drop)
    return _extended(body, texts, Path(folder), path, limits, timing=False)


def note_derived(body: bytes, path: str, limits: Limits) -> None:
    """Store variables by formula, which `derive` has checked, with the results in a directory."""
    from tripod_doe.study.result_directory.directory import ResultDirectory

    asked = read_form(body, Derivation, limits.nesting)
    with ResultDirectory(path) as directory:
        directory.note_derived(asked.responses, asked.drop)


def plan_extension(body: bytes, path: str, texts: Mapping[str, str], limits: Limits) -> Any:
    """Price of what a larger study, or variables by formula, add to the results in a directory."""
    asked = read_form(body, ExtensionPlan, limits.nesting)
    if asked.responses is None:
        _, texts = upload_texts(asked.model_dump())
    else:
        texts = _with_responses(texts, asked.responses)
    with tempfile.TemporaryDirectory(prefix="tripod-doe-") as name:
        return _extended(body, texts, Path(name) / UPLOAD, path, limits, asked.timing)


def _with_responses(texts: Mapping[str, str], tables: Mapping[str, Any], drop: Collection[str] = ()) -> dict[str, str]:
    """The texts of an upload, its study with responses, or without some."""
    from tripod_doe.study.result_directory.derived_responses import text_with_responses

    return {**texts, STUDY: text_with_responses(texts[STUDY], tables, drop)}


def _extended(
    body: bytes, texts: Mapping[str, str], folder: Path, path: str, limits: Limits, timing: bool
) -> dict[str, Any]:
    """Counts and price of a larger study, with the number of its new points and their price."""
    with _pointing_into(texts):
        counted = _checked(body, "study", texts, folder, limits)
        try:
            with _plain_names(folder):
                counted |= _news(folder, Path(path), timing)
        except InputError as error:
            changed = (
                f"the study differs from the study of the results in {path}; choose another {option('out')}, or undo"
            )
            here = "the study may only grow; submit it as a run of its own, or undo"
            message = str(error).replace(changed, here)
            message = re.sub(
                "run the study (with it )?into another directory", "submit it as a run of its own", message
            )
            raise InputError(message.replace(path, "this run")) from error
    return counted


def _checked(body: bytes, kind: str, texts: Mapping[str, str], folder: Path, limits: Limits) -> dict[str, Any]:
    from tripod_doe.service.requests.plans import plan_upload

    _write(body, texts, folder, limits)
    with _plain_names(folder):
        return plan_upload(folder, kind, limits, timing=False)


def plan_directory(path: str, limits: Limits) -> Any:
    """Counts of the study of a directory that the command line filled, or of what was submitted there."""
    from tripod_doe.service.requests.plans import plan_stored, plan_upload

    upload, kinds = Path(path) / UPLOAD, KINDS if (Path(path) / STUDY).exists() else KINDS[1:]
    kind = next((kind for kind in kinds if (upload / main_file(kind)).is_file()), "study")
    return plan_stored(Path(path), limits) if kind == "study" else plan_upload(upload, kind, limits, timing=False)


def changes(body: bytes, limits: Limits) -> Any:
    """Changes that a request makes to the annotation of a run."""
    return read_form(body, RunChange, limits.nesting).model_dump(exclude_none=True)


def diff(a: str, b: str, variables: list[str]) -> bytes:
    """What differs between the studies and results of two directories, as ``diff --format json`` gives it."""
    from tripod_doe.analyses.diff.diff import diff as differences
    from tripod_doe.analyses.diff.sentences import diff_json

    return diff_json(differences(a, b, variables)).encode()


def simulate(body: bytes, limits: Limits) -> Any:
    """One point, as ``simulate --format json`` gives it."""
    from tripod_doe.study.simulate import simulate_point

    parameters = read_json(body, limits.nesting)
    if not isinstance(parameters, dict):
        raise RefusedError(422, "the body must be an object: {parameter: value}")
    scene = parameters.pop("scene", "joint")
    if not isinstance(scene, str):
        raise RefusedError(422, *problems_of(f"scene = {scene!r}: a name is needed", {}))
    return simulate_point(scene, **parameters).record()


def small_query(path: str, variable: str, select: list[str], nearest: bool, **more: Any) -> bytes | None:
    """The answer of `query` if it is small; None if it is large, and the worker for large answers must be asked."""
    from tripod_doe.study.query.query import cell_count
    from tripod_doe.study.result_directory.open_cube import opened_cube

    with opened_cube(path) as cube:
        if cell_count(cube, variable, select, nearest) > _MOST_AT_ONCE:
            return None
    return query(path, variable, select, nearest, **more)


def query(
    path: str,
    variable: str,
    select: list[str],
    nearest: bool,
    where: str | None,
    form: str,
    limits: Limits,
    decimal_comma: bool = False,
) -> bytes:
    """Cells of a cube as ``query`` gives them: JSON or CSV text, a netCDF file or a workbook."""
    from tripod_doe.reports.workbook import answer_workbook
    from tripod_doe.study.query.query import cell_count, narrowed, records, records_text
    from tripod_doe.study.query.query import query as cells_of
    from tripod_doe.study.result_directory.open_cube import opened_cube

    with opened_cube(path) as cube:
        count = cell_count(cube, variable, select, nearest)
        if count > limits.cells:
            raise TooLargeError(
                f"select: {count:,} cells; at most {limits.cells:,} are sent in one answer: select fewer"
            )
        if form != "netcdf":
            columns = records(cube, variable, select, nearest, where)
            rows = columns[variable].size
            first = {name: column[:_SAMPLE] for name, column in columns.items()}
            shown = "csv" if form == "xlsx" else form
            _refuse_large(len(records_text(first, shown)) * max(rows, 1) // max(min(rows, _SAMPLE), 1), limits)
            if form == "xlsx":
                asked = {"variable": variable, "select": ", ".join(select), "where": where or ""}
                answer = answer_workbook(path, columns, asked)
            else:
                answer = records_text(columns, form, decimal_comma).encode()
        else:
            answer = _netcdf_bytes(narrowed(cells_of(path, variable, select, nearest, where)))
    _refuse_large(len(answer), limits)
    return answer


def handed_on(path: str, form: str) -> bytes:
    """A result directory on one page (pdf, html), its tables as a workbook (xlsx), or its page that asks what if."""
    from tripod_doe.reports.one_page import one_page, what_if_alone
    from tripod_doe.reports.workbook import tables_of

    if form == "xlsx":
        return tables_of(Path(path))
    if form == "what-if":
        return what_if_alone(Path(path)).encode()
    page = one_page(Path(path))
    return page.pdf() if form == "pdf" else page.html().encode()


def _refuse_large(size: int, limits: Limits) -> None:
    if size > limits.answer_bytes:
        raise TooLargeError(
            f"select: an answer of about {size:,} bytes; at most {limits.answer_bytes:,} are sent: select fewer cells, "
            "or take cube.nc"
        )


def is_damaged(path: str) -> bool:
    """Whether a file of a result directory is damaged or lost."""
    from tripod_doe.study.result_directory.check import check_files

    return not all(file.is_whole for file in check_files(Path(path)))


def describe(path: str) -> Any:
    """What a cube holds: dimensions, coordinates with their values, variables with units and flags, attributes."""
    from tripod_doe.service.explorer.descriptions import describe_cube
    from tripod_doe.study.result_directory.open_cube import opened_cube

    with opened_cube(path) as cube:
        return describe_cube(cube)


def analyses(paths: dict[str, str]) -> Any:
    """Results of analyses by name: kind, sentences, table and variables."""
    from tripod_doe.service.explorer.descriptions import describe_analysis
    from tripod_doe.study.cube.lazy_dataset import read_dataset

    return [describe_analysis(name, read_dataset(Path(path))) for name, path in paths.items()]


def base(path: str, kind: str, candidate: int | None) -> str:
    """The joint of a search's result, as [base] to paste into a study; of a front, one candidate or the knee."""
    from tripod_doe.analyses.optimisation.stored_candidates import base_of, knee_of
    from tripod_doe.study.cube.lazy_dataset import read_dataset

    if kind == "fit":
        if candidate is not None:
            raise RefusedError(404, "a fit gives one joint: leave out candidate")
        return read_text(Path(path).with_name("base.toml"), "joint")
    front = read_dataset(Path(path))
    try:
        return base_of(front, knee_of(front) if candidate is None else candidate)
    except InputError as error:
        raise RefusedError(404, str(error)) from error


def choice(folder: str, path: str) -> Any:
    """Lines on the choice of model of a study with model = "auto", or on the split of a multifidelity study."""
    from tripod_doe.analyses.model_choice.study_choice import describe_choice
    from tripod_doe.analyses.multifidelity.study_split import describe_split
    from tripod_doe.study.definition.study_file import load_study

    place = Path(folder) / STUDY
    study = load_study(place, StudyFolder(place.resolve().parent, trusted=False, has_results=True))
    return describe_choice(study, Path(path)).splitlines() if study.auto_model else describe_split(study, Path(path))


def _news(folder: Path, path: Path, timing: bool) -> dict[str, Any]:
    """Additions of a larger study: ``new_points`` and their ``cpu_seconds``; None if a pilot decides.

    Raises:
        InputError: If the study changed in any way other than growth.
    """
    from tripod_doe.analyses.multifidelity.study_split import needs_split, with_samples_so_far
    from tripod_doe.service.requests.plans import price_of
    from tripod_doe.study.definition.study_file import parse_study
    from tripod_doe.study.designs import make_points
    from tripod_doe.study.plan import plan as plan_study
    from tripod_doe.study.result_directory.directory import ResultDirectory
    from tripod_doe.study.study_points import StudyPoints

    study = parse_study((folder / STUDY).read_text(encoding="utf-8"), STUDY, StudyFolder(folder, trusted=False))
    piloted = needs_split(study) or study.auto_model is not None
    if needs_split(study):
        study = with_samples_so_far(study, path)
    asked = StudyPoints(study, make_points(study))
    with ResultDirectory(path) as directory:
        directory.resume.refuse_changes(asked)
        missing = directory.resume.missing(asked)
    if piloted:
        return {"new_points": None}
    if not missing.size:
        return {"new_points": 0, "cpu_seconds": {"low": 0.0, "mean": 0.0, "high": 0.0}, "timed": 0}
    return {"new_points": int(missing.size), **price_of(plan_study(study, timing, recorded=True, among=missing))}


def _netcdf_bytes(dataset: Any) -> bytes:
    from tripod_doe.study.cube.netcdf import write_dataset

    with tempfile.TemporaryDirectory(prefix="tripod-doe-") as name:
        path = Path(name) / "answer.nc"
        write_dataset(dataset, path)
        return path.read_bytes()


@contextmanager
def _pointing_into(texts: Mapping[str, str]) -> Iterator[None]:
    """Add to complaints the line and column in their text."""
    try:
        yield
    except InputError as error:
        raise refusal_of(error, texts) from error


@contextmanager
def _plain_names(folder: Path) -> Iterator[None]:
    """Let complaints use the plain names of files in a folder."""
    try:
        yield
    except InputError as error:
        raise type(error)(str(error).replace(f"{folder}/", "")) from error
