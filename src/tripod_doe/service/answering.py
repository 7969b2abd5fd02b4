"""A process that answers questions of the server: one JSON line in, one JSON line and perhaps bytes out.

Questions are the functions of `QUESTIONS`. They call what the command line calls, so the numbers are the same.
"""

from __future__ import annotations

import json
import resource
import sys
import tempfile
import traceback
from collections.abc import Callable, Mapping
from functools import partial
from importlib import import_module
from io import BufferedWriter, TextIOWrapper
from pathlib import Path
from typing import IO, Any, cast

from tripod_doe.errors import ForbiddenError, InputError, TooLargeError, TripodDoeError, option
from tripod_doe.service.limits import Limits
from tripod_doe.service.uploads import STUDY, refuse_many_files, write_upload
from tripod_doe.study.execution.child_process import answers
from tripod_doe.study.study_folder import StudyFolder

Answer = tuple[Any, bytes]


def plan(main: str, texts: dict[str, str], limits: dict[str, Any], timing: bool) -> Answer:
    """Price of an uploaded study or workflow; see `plans`."""
    from tripod_doe.service.plans import plan_upload

    allowed = Limits(**limits)
    refuse_many_files(texts, allowed)
    with tempfile.TemporaryDirectory(prefix="tripod-doe-") as name:
        folder = Path(name) / "upload"
        write_upload(folder, texts)
        return _in_folder(folder, lambda: plan_upload(folder, main, allowed, timing)), b""


def check(main: str, folder: str, texts: dict[str, str], limits: dict[str, Any]) -> Answer:
    """Check an upload that is written into its folder, and count the points of its main file."""
    from tripod_doe.service.plans import plan_upload

    allowed = Limits(**limits)
    refuse_many_files(texts, allowed)
    return _in_folder(Path(folder), lambda: plan_upload(Path(folder), main, allowed, timing=False)), b""


def found(path: str, limits: dict[str, Any]) -> Answer:
    """Counts of the study of a directory that the command line filled."""
    from tripod_doe.service.found import plan_found

    return plan_found(Path(path), Limits(**limits)), b""


def simulate(scene: str, parameters: dict[str, Any]) -> Answer:
    """One point, as ``simulate --format json`` gives it."""
    from tripod_doe.study.simulate import simulate_point

    return simulate_point(scene, **parameters).record(), b""


def query(
    path: str, variable: str, select: list[str], nearest: bool, where: str | None, form: str, cells: int
) -> Answer:
    """Cells of a cube as ``query`` gives them: JSON or CSV text, or the bytes of a netCDF file."""
    from tripod_doe.study.query.arrays import opened_arrays
    from tripod_doe.study.query.query import cell_count, narrowed, records, records_text
    from tripod_doe.study.query.query import query as cells_of

    with opened_arrays(path) as cube:
        count = cell_count(cube, variable, select, nearest)
        if count > cells:
            raise TooLargeError(f"select: {count:,} cells; at most {cells:,} are sent in one answer: select fewer")
        if form != "netcdf":
            columns = records(cube, variable, select, nearest, where)
            return None, records_text(columns, form).encode()
    return None, _netcdf_bytes(narrowed(cells_of(path, variable, select, nearest, where)))


def cube(path: str, folder: str) -> Answer:
    """Write the cube of a run so far into a folder, with its costs."""
    from tripod_doe.study.cube.results import write_cube_so_far

    write_cube_so_far(Path(path), Path(folder))
    return None, b""


def describe(path: str) -> Answer:
    """What a cube holds: dimensions, coordinates with their values, variables with units and flags, attributes."""
    from tripod_doe.service.descriptions import describe_cube
    from tripod_doe.study.cube.results import opened_cube

    with opened_cube(path) as cube:
        return describe_cube(cube), b""


def analyses(paths: dict[str, str]) -> Answer:
    """Results of analyses by name: kind, sentences, table and variables."""
    from tripod_doe.service.descriptions import describe_analysis
    from tripod_doe.study.cube.netcdf import read_dataset

    return [describe_analysis(name, read_dataset(Path(path))) for name, path in paths.items()], b""


def compare(path: str, measurement: str, settings: dict[str, Any]) -> Answer:
    """A measurement beside a point of a cube, as ``compare --format json`` gives it."""
    from tripod_doe.service.measurements import compare_upload

    return compare_upload(path, measurement, **settings), b""


def choice(folder: str, path: str) -> Answer:
    """Lines on the choice of model of a study with model = "auto", or on the split of a multifidelity study."""
    from tripod_doe.analyses.model_choice.study_choice import describe_choice
    from tripod_doe.analyses.multifidelity.study_split import describe_split
    from tripod_doe.study.definition import load_study

    place = Path(folder) / STUDY
    study = load_study(place, StudyFolder.of(place, untrusted=True))
    lines = describe_choice(study, Path(path)).splitlines() if study.accuracy else describe_split(study, Path(path))
    return lines, b""


def extend(folder: str, path: str, texts: dict[str, str], limits: dict[str, Any]) -> Answer:
    """Check the larger version of a study whose results are in a directory; anything but growth is refused."""
    told, _ = check(STUDY, folder, texts, limits)
    try:
        _in_folder(Path(folder), lambda: _refuse_changes(Path(folder), Path(path)))
    except InputError as error:
        changed = f"the study differs from that of the results in {path}; choose another {option('out')}, or undo"
        told_here = "the study may only grow; submit it as a run of its own, or undo"
        raise InputError(str(error).replace(changed, told_here).replace(path, "this run")) from error
    return told, b""


def _refuse_changes(folder: Path, path: Path) -> None:
    from tripod_doe.analyses.multifidelity.study_split import needs_split, with_samples_so_far
    from tripod_doe.study.definition import parse_study
    from tripod_doe.study.designs import make_points
    from tripod_doe.study.directory import ResultDirectory
    from tripod_doe.study.study_points import StudyPoints

    study = parse_study((folder / STUDY).read_text(encoding="utf-8"), STUDY, StudyFolder(folder, trusted=False))
    if needs_split(study):
        study = with_samples_so_far(study, path)
    asked = StudyPoints(study, make_points(study))
    with ResultDirectory(path) as directory:
        directory.refuse_changes(asked)


def _netcdf_bytes(dataset: Any) -> bytes:
    from tripod_doe.study.cube.netcdf import write_dataset

    with tempfile.TemporaryDirectory(prefix="tripod-doe-") as name:
        path = Path(name) / "answer.nc"
        write_dataset(dataset, path)
        return path.read_bytes()


def _later(module: str, question: str, **arguments: Any) -> Answer:
    answer: Answer = getattr(import_module(f"tripod_doe.service.{module}"), question)(**arguments)
    return answer


_LATER = {
    "explorer.questions": ("explore", "extremes", "figure", "numbers", "failures", "parameters", "point"),
    "explorer.again": ("contribution_study", "price_of_point", "simulated"),
    "explorer.results": ("results", "behind"),
    "study_form": ("study_form", "changed_text"),
    "measurements": ("lay_over",),
}
QUESTIONS: Mapping[str, Callable[..., Answer]] = {
    function.__name__: function
    for function in (plan, check, found, simulate, query, cube, describe, analyses, compare, choice, extend)
} | {question: partial(_later, module, question) for module, questions in _LATER.items() for question in questions}
"""Questions by name."""


def _in_folder(folder: Path, step: Callable[[], Any]) -> Any:
    """Run a step; its sentences speak of uploaded files by their plain names."""
    try:
        return step()
    except InputError as error:
        raise type(error)(str(error).replace(f"{folder}/", "")) from error


def _answer(asked: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
    try:
        answer, data = QUESTIONS[asked["question"]](**asked["arguments"])
        return {"answer": answer, "bytes": len(data)}, data
    except ForbiddenError as error:
        kind, text = "forbidden", str(error)
    except TooLargeError as error:
        kind, text = "too large", str(error)
    except InputError as error:
        kind, text = "input", str(error)
    except MemoryError:
        kind, text = "too large", "the answer needs more memory than is allowed here"
    except TripodDoeError as error:
        kind, text = "other", str(error)
    except Exception as error:
        traceback.print_exc()
        kind, text = "other", f"{type(error).__name__}: {error}"
    return {"error": kind, "text": text, "bytes": 0}, b""


def _serve(requests: IO[str], stream: BufferedWriter) -> None:
    for line in requests:
        head, data = _answer(json.loads(line))
        stream.write(json.dumps(head, allow_nan=False).encode() + b"\n" + data)
        stream.flush()


if __name__ == "__main__":
    most = int(sys.argv[1])
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    stream = cast(TextIOWrapper, answers())  # it closes when nothing refers to it
    _serve(sys.stdin, cast(BufferedWriter, stream.buffer))
