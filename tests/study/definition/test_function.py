"""User functions as simulators: arguments as written, answers side by side."""

from __future__ import annotations

import os
import re
import sys
from contextlib import nullcontext
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import tripod_doe as td
from tripod_doe.errors import InputError, TripodDoeError
from tripod_doe.model_interface import BlockResult
from tripod_doe.study.cube.dataset import COST_VARIABLES, EXCLUDED, build_cube
from tripod_doe.study.definition.function_sources import source_hash, sources_of
from tripod_doe.study.definition.simulators import load_simulator
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.designs import make_points
from tripod_doe.study.execution.task import make_task, run_task
from tripod_doe.study.fingerprints import point_keys
from tripod_doe.study.journal import FinishedBlock
from tripod_doe.study.simulate import simulate

pytestmark = pytest.mark.usefixtures("pages_not_made")

FUNCTIONS = """
def echo(n, mode="sum", scale=2):
    rows = range(n)                       # a float would not do
    return {"y": scale * (sum(rows) if mode == "sum" else len(rows))}

def partly(x):
    return {"a": x} if x < 2 else {"a": x, "b": 2 * x}

def growing(x):
    return {"a": list(range(int(x)))}
"""


def answer(tmp_path, function, factors):
    (tmp_path / "told_functions.py").write_text(FUNCTIONS)
    text = f'[study]\nname = "f"\nfunction = "told_functions:{function}"\n{factors}'
    study = parse_study(text, folder=StudyFolder(tmp_path))
    points = make_points(study)
    return run_task(make_task(study, points, np.arange(points.count)))[0]


def test_arguments_come_as_they_are_written(tmp_path):
    result = answer(tmp_path, "echo", '[factors]\nn = {values = [3, 4]}\nmode = {values = ["sum", "count"]}\n')
    assert result.detail == [""] * 4
    assert result.outputs["y"].data.tolist() == [6, 6, 12, 8]


UNFIT = ["rms/force", " ", "", "-a", "=a", "(a)", "a ", "a\x01", "\ud800", "e\u0301", "a" * 300]


@pytest.mark.parametrize("name", [*UNFIT, "x", "outcome", "point", *COST_VARIABLES, "worker", EXCLUDED])
def test_a_name_that_a_cube_cannot_hold_is_refused_at_the_first_point(tmp_path, name):
    """Regression: an internal error after the last point, or the answer lost behind the steps of the run."""
    (tmp_path / "named_functions.py").write_text(f"def named(x):\n    return {{{name!r}: x}}\n")
    text = '[study]\nname = "f"\nfunction = "named_functions:named"\n[factors]\nx = { values = [1] }\n'
    study = parse_study(text, folder=StudyFolder(tmp_path))
    with pytest.raises(InputError, match=r"^output '.*: (a cube cannot hold this name|this name is taken)"):
        run_task(make_task(study, make_points(study), np.arange(1)))
    sys.modules.pop("named_functions", None)


@pytest.mark.parametrize(
    "answer",
    [
        *(f"xr.Dataset({{'y': ({dim!r}, [1.0])}})" for dim in ("-d", "x", "point", "a/b")),
        "{'y': [1.0], 'y_0': 2.0}",
        "xr.Dataset({'y': 1.0}, {'-label': [1.0]})",
        *(
            f"xr.Dataset({{'y': ('d', [1.0, 2.0])}}, {{'d': {labels}}})"
            for labels in (
                "['a', 'a\\0b']",
                "np.array(['2026-01-01', '2026-01-02'], 'M8[ns]')",
                "[1, 1j]",
                "[2**53, 2**53 + 1]",
                "np.array([1, 'a'], object)",
                "[b'a', b'b']",
            )
        ),
    ],
)
def test_a_dimension_that_a_cube_cannot_hold_is_refused_at_the_first_point(tmp_path, answer):
    """Regression: labels that are dates ended in an internal error after the last point, others in a damaged journal."""
    (tmp_path / "dimension_functions.py").write_text(
        f"import numpy as np, xarray as xr\ndef f(x):\n    return {answer}\n"
    )
    text = '[study]\nname = "f"\nfunction = "dimension_functions:f"\n[factors]\nx = { values = [1] }\n'
    study = parse_study(text, folder=StudyFolder(tmp_path))
    with pytest.raises(InputError, match=r"^(dimension|output) "):
        run_task(make_task(study, make_points(study), np.arange(1)))


def test_a_whole_number_that_a_cube_would_round_is_refused(tmp_path):
    """Regression: two points became one, and the function got another number than was written."""
    with pytest.raises(InputError, match="n = 9007199254740993: a whole number that float64 does not hold"):
        answer(tmp_path, "echo", "[factors]\nn = {values = [9007199254740992, 9007199254740993]}\n")


def test_a_text_that_a_cube_would_cut_is_refused(tmp_path):
    """Regression: netCDF ends a text at a NUL, so two levels had one name, and a query of it gave both."""
    with pytest.raises(InputError, match=r"mode = .* a text with a NUL"):
        answer(tmp_path, "echo", '[factors]\nn = {values = [3]}\nmode = {values = ["sum", "sum\\u0000b"]}\n')


def one_point(tmp_path, answer):
    (tmp_path / "number_functions.py").write_text(f"import numpy as np, xarray as xr\ndef f(x):\n    return {answer}\n")
    text = '[study]\nname = "f"\nfunction = "number_functions:f"\n[factors]\nx = { values = [1] }\n'
    study = parse_study(text, folder=StudyFolder(tmp_path))
    return run_task(make_task(study, make_points(study), np.arange(1)))[0]


@pytest.mark.parametrize("given", ["np.fft.rfft([1.0])", "np.array([5], 'm8[s]')", "np.array(['2026-01-01'], 'M8[D]')"])
@pytest.mark.parametrize("form", ["{{'y': {}}}", "xr.Dataset({{'y': ('d', {})}})"])
def test_numbers_of_which_a_cube_would_hold_a_part_are_refused(tmp_path, given, form):
    """Regression: the real part of complex ones was taken, and of times the count of whatever unit they had."""
    assert "give real numbers" in one_point(tmp_path, form.format(given)).detail[0]


@pytest.mark.parametrize(
    ("given", "expected"), [("np.ma.array([1, 2], mask=[0, 1])", [[1, np.nan]]), ("np.ma.masked", [np.nan])]
)
def test_a_masked_number_is_nan(tmp_path, given, expected):
    """Regression: it was the number below the mask, and the mean of nothing was 0."""
    np.testing.assert_equal(one_point(tmp_path, f"{{'y': {given}}}").outputs["y"].data, expected)


def test_an_argument_that_a_cube_cannot_hold_is_refused_before_anything_runs(tmp_path):
    (tmp_path / "argument_functions.py").write_text("def f(point):\n    return {'y': 1.0}\n")
    text = '[study]\nname = "f"\nfunction = "argument_functions:f"\n[factors]\npoint = { values = [1] }\n'
    with pytest.raises(InputError, match="argument point: every cube holds this name"):
        parse_study(text, folder=StudyFolder(tmp_path))


@pytest.mark.parametrize("default", ["[]", "{}", "(1, 2)", "object()"])
def test_a_default_that_is_no_value_is_refused(default, tmp_path):
    (tmp_path / "kept.py").write_text(f"def f(x, kept={default}):\n    return {{'y': x}}\n")
    text = '[study]\nname = "k"\nfunction = "kept:f"\n[factors.x]\nvalues = [1, 2]\n'
    with pytest.raises(InputError, match=r"argument kept=.*: its default must be a number or a word"):
        parse_study(text, folder=StudyFolder(tmp_path))


def test_an_answer_that_a_point_does_not_give_is_nan(tmp_path):
    result = answer(tmp_path, "partly", "[factors]\nx = {values = [1, 3]}\n")
    assert result.outputs["b"].data.tolist() == pytest.approx([np.nan, 6], nan_ok=True)


def test_answers_of_different_shape_are_refused(tmp_path):
    with pytest.raises(InputError, match="a: points have different shapes"):
        answer(tmp_path, "growing", "[factors]\nx = {values = [1, 3]}\n")


@pytest.mark.parametrize("apart", [False, True])
@pytest.mark.parametrize(
    ("answer", "message"),
    [
        ("{'y': ('t', [1.0, 2.0])}, {'t': [x, 5.0]}", "dimension 't': points have different labels"),
        ("{'y': ('t', [1.0, 2.0])}, {'t': ['a', 'b'] if x < 2 else ['b', 'a']}", "points have different labels"),
        ("{'y': (('a', 'b') if x < 2 else ('b', 'a'), np.eye(2))}", "points have different dimensions a, b and b, a"),
    ],
)
def test_labels_that_only_some_points_have_are_refused(tmp_path, apart, answer, message):
    """Regression: a cube had the labels of its last point, and the dimensions of its first one, at all points."""
    code = f"import numpy as np, xarray as xr\ndef f(x):\n    return xr.Dataset({answer})\n"
    (tmp_path / "labelling_functions.py").write_text(code)
    text = '[study]\nname = "f"\nfunction = "labelling_functions:f"\n[factors.x]\nvalues = [1, 2]\n'
    study = parse_study(text, folder=StudyFolder(tmp_path))
    with pytest.raises(TripodDoeError, match=message):
        cube_of(study, [[0], [1]] if apart else [[0, 1]])


def cube_of(study, numbers):
    points = make_points(study)
    keys = point_keys(study, points)
    done = [run_task(make_task(study, points, np.array(each))) for each in numbers]
    blocks = (FinishedBlock(keys[each], *block, "0") for each, block in zip(numbers, done, strict=True))
    return build_cube(study, points, keys, blocks)


def test_a_single_point_is_labelled_like_a_cube():
    result = simulate(samples_per_revolution=36)
    assert result["rotation_deg"].attrs["units"] == "degree"
    assert result["thrust"].attrs["units"] == "N"
    assert "finished" in result["outcome"].attrs["flag_meanings"].split()


def test_each_study_takes_the_function_of_its_own_folder(tmp_path):
    """Modules of one name in two folders are two modules, in whichever order their studies run."""
    answers = []
    for folder, factor in (("one", 2), ("two", 3), ("one", 2)):
        place = tmp_path / folder
        place.mkdir(exist_ok=True)
        (place / "same_name.py").write_text(f"def f(x):\n    return {{'y': {factor} * x}}\n")
        (place / "s.toml").write_text('[study]\nname = "s"\nfunction = "same_name:f"\n[factors.x]\nvalues = [1.0]\n')
        td.run(place / "s.toml", tmp_path / f"out{len(answers)}", workers=0, progress=False)
        answers.append(float(td.open_cube(tmp_path / f"out{len(answers)}")["y"][0]))
        (copy := place / "results").mkdir(exist_ok=True)  # regression: a folder without a module counted as where it is
        load_simulator(function="same_name:f", folder=StudyFolder(copy))
    assert answers == [2, 3, 2]


MEASURED = """
import xarray as xr
def measured(x):
    units = {units}
    force = xr.DataArray([x, 2 * x], dims="place", attrs={{"units": units}} if units else {{}})
    return xr.Dataset({{"force": force, "share": 0.5}})
"""


def test_units_of_a_dataset_are_those_of_the_cube(tmp_path):
    """Also after the journal, and where the first points of the study do not give them."""
    (tmp_path / "measured_functions.py").write_text(MEASURED.format(units="'kN' if x > 1 else None"))
    (tmp_path / "s.toml").write_text(
        '[study]\nname = "s"\nfunction = "measured_functions:measured"\n[factors]\nx = { values = [1, 2, 3] }\n'
    )
    td.run(tmp_path / "s.toml", tmp_path / "out", workers=0, progress=False)
    cube = td.open_cube(tmp_path / "out")
    assert cube["force"].attrs["units"] == "kN"
    assert cube["force"].values.tolist() == [[1, 2], [2, 4], [3, 6]]
    assert cube["share"].attrs["units"] == "1"


def test_different_units_of_one_output_are_refused(tmp_path):
    (tmp_path / "mixed_functions.py").write_text(MEASURED.format(units="'kN' if x > 1 else 'N'"))
    text = '[study]\nname = "s"\nfunction = "mixed_functions:measured"\n[factors]\nx = { values = [1, 2] }\n'
    study = parse_study(text, folder=StudyFolder(tmp_path))
    with pytest.raises(InputError, match="force: points have different units 'N' and 'kN'"):
        run_task(make_task(study, make_points(study), np.arange(2)))


def test_units_stay_with_some_points_of_a_block():
    block = BlockResult.blank(3, td.Outcome.FINISHED)
    block.put("force", (), slice(None), np.arange(3.0), "N")
    whole = BlockResult.blank(3)
    whole.fill(np.array([2, 0]), block.take(np.array([0, 1])))
    assert whole.outputs["force"].unit == "N"
    assert whole.outputs["force"].data.tolist() == pytest.approx([1, np.nan, 0], nan_ok=True)


def test_no_dataset_is_made_of_a_dict(tmp_path, monkeypatch):
    """Regression: it cost twenty times as much as the call of a cheap function."""
    monkeypatch.setattr(xr.Dataset, "__init__", lambda *given, **more: pytest.fail("a Dataset was made"))
    result = answer(tmp_path, "growing", "[factors]\nx = {values = [2]}\n")
    assert result.outputs["a"].dims == ("a_0",)
    assert result.outputs["a"].data.tolist() == [[0, 1]]


HELPER = "from helper_of_both import factor\ndef f(x):\n    return {'y': factor() * x}\n"
FACTORS = "\n[factors.x]\nvalues = [1, 2]\n"


def test_a_helper_is_that_of_the_folder_of_the_study(tmp_path):
    """Regression: a helper that a study in another folder had imported, or its old text, was used in silence."""
    for folder, name, factor in (("one", "first_user", 1), ("two", "second_user", 100), ("two", "third_user", 100)):
        (tmp_path / folder).mkdir(exist_ok=True)
        (tmp_path / folder / f"{name}.py").write_text(HELPER)
        (tmp_path / folder / "helper_of_both.py").write_text(f"def factor():\n    return {factor}\n")
        (tmp_path / folder / f"{name}.toml").write_text(f'[study]\nname = "f"\nfunction = "{name}:f"{FACTORS}')

    def computed(place):
        td.run(tmp_path / f"{place}.toml", out=tmp_path / "out" / f"{place}{len(outs)}", workers=0, progress=False)
        outs.append(place)
        return td.open_cube(tmp_path / "out" / f"{place}{len(outs) - 1}")["y"].values.tolist()

    outs = []
    for place, factor in (("one/first_user", 1), ("two/second_user", 100), ("one/first_user", 1)):
        assert computed(place) == [factor, 2 * factor]
    assert computed("two/second_user") == [100, 200]
    helper = tmp_path / "two" / "helper_of_both.py"
    written = helper.stat().st_mtime
    helper.write_text("def factor():\n    return 5.0\n")
    os.utime(helper, (written, written))  # of the same size and second: its bytecode counts as fresh
    assert computed("two/third_user") == computed("two/second_user") == [5, 10]


@pytest.fixture
def define(monkeypatch):
    """Defines a function of a session without a file, as in a notebook, and gives its reference."""
    session = ModuleType("__main__")
    monkeypatch.setitem(sys.modules, "__main__", session)

    def defined(text):
        exec(text, vars(session))
        return "__main__:f"

    return defined


NO_VERSION = (
    r"holds points already, and no file shows whether they are of this version of __main__:f: choose another out"
)


def test_points_of_a_function_without_a_file_are_not_used_again(define, tmp_path):
    """Regression: of a notebook, those of an earlier version were shown where taking it apart missed a change."""
    tables = {
        "study": {"name": "s", "function": define("def f(x): return {'y': x}")},
        "factors": {"x": {"values": [1]}},
    }
    with pytest.raises(InputError, match="give workers=0"):  # which computes nothing
        td.run(tables, tmp_path / "out", workers=1, progress=False)
    td.run(tables, tmp_path / "out", workers=0, progress=False)
    with pytest.raises(InputError, match=NO_VERSION):
        td.run(tables, tmp_path / "out", workers=0, progress=False)
    (tmp_path / "more.toml").write_text('[responses.z]\nformula = "2 * y"\nunit = "1"\nmeaning = "twice"\n')
    td.derive(tmp_path / "out", tmp_path / "more.toml")
    assert td.open_cube(tmp_path / "out")["z"].values.tolist() == [2]


def test_a_pilot_of_a_function_without_a_file_is_not_used_again(define, tmp_path):
    text = (
        "from tripod_doe.model_interface import Candidate\ndef f(x, model=1): return {'y': 10 + x, 'y_error': 0.001}\n"
    )
    text += "f.candidates = Candidate({'model': 1}, 1e-3, 1), Candidate({'model': 2}, 1.0, 1, full=True)"
    head = f'[study]\nname = "s"\nfunction = "{define(text)}"\n[base]\nmodel = "auto"\n[accuracy]\ny = 0.03\n'
    study = parse_study(f"{head}[factors]\nx = {{low = 0, high = 1, count = 40}}\n")
    assert td.run(study, tmp_path / "out", workers=0, progress=False).complete
    assert (tmp_path / "out" / "pilot" / "journal.sqlite").is_file()
    (tmp_path / "out" / "journal.sqlite").unlink()  # as of a run that ended within its pilot
    with pytest.raises(InputError, match=NO_VERSION):
        td.run(study, tmp_path / "out", workers=0, progress=False)


@pytest.mark.slow
def test_points_of_a_search_of_a_function_without_a_file_are_not_used_again(define, tmp_path):
    function = define("def f(x): return {'y': (x - 1) ** 2}")
    head = f'[optimisation]\nname = "o"\nfunction = "{function}"\n'
    tail = '[objectives.y]\noutput = "y"\ngoal = "minimise"\n[search]\nevaluations = 8\nseed = 1\n'
    (tmp_path / "o.toml").write_text(f"{head}[variables.x]\nlow = 0\nhigh = 3\n{tail}")
    for refused in (nullcontext(), pytest.raises(InputError, match=NO_VERSION)):
        with refused:
            td.optimise(tmp_path / "o.toml", tmp_path / "out", workers=0, progress=False)


def test_a_step_of_a_function_without_a_file_is_not_used_again(define, tmp_path):
    function = define("def f(x): return {'y': x}")
    (tmp_path / "s.toml").write_text(f'[study]\nname = "s"\nfunction = "{function}"\n[factors.x]\nvalues = [1]\n')
    (tmp_path / "w.toml").write_text('[workflow]\nname = "w"\n[steps.one]\nkind = "study"\nstudy = "s.toml"\n')
    first, again = (
        td.run_workflow(tmp_path / "w.toml", tmp_path / "out", workers=0, progress=False).steps[0] for _ in "12"
    )
    assert first.state == "finished"
    assert again.state == "failed"
    assert re.search(NO_VERSION, again.detail)


def test_a_function_of_an_interactive_session_has_no_version(tmp_path, monkeypatch):
    """Regression: python -i has the file of its script, and a function that was defined anew gave the points before."""
    script = ModuleType("__main__")
    script.__file__ = str(tmp_path / "script.py")
    Path(script.__file__).write_text("def f(x): return {'y': x}\n")
    monkeypatch.setitem(sys.modules, "__main__", script)
    assert sources_of("__main__").keys() == {"__main__"}
    monkeypatch.setattr(sys, "flags", SimpleNamespace(inspect=1))
    assert sources_of("__main__") == {}


def test_points_of_another_version_are_refused_without_the_study_file(tmp_path):
    """Regression: where study.toml was gone, points of an earlier version of a function were shown."""
    text = '[study]\nname = "s"\nfunction = "edited_later:f"\n[factors.x]\nvalues = [1]\n'
    (tmp_path / "edited_later.py").write_text("def f(x): return {'y': x}\n")
    td.run(parse_study(text, folder=StudyFolder(tmp_path)), tmp_path / "out", workers=0, progress=False)
    (tmp_path / "out" / "study.toml").unlink()
    (tmp_path / "edited_later.py").write_text("def f(x): return {'y': 3.0 * x}\n")
    with pytest.raises(InputError, match="computed by another version of edited_later:f"):
        td.run(parse_study(text, folder=StudyFolder(tmp_path)), tmp_path / "out", workers=0, progress=False)


@pytest.mark.parametrize(
    "imports", ["import {}", "from importlib import import_module\nh = lambda: import_module('{}')"]
)
def test_a_compiled_module_counts_and_stays_loaded(tmp_path, imports):
    """Regression: of another build of a module beside the function, the old points were shown."""
    name = f"user_of_build_{len(imports)}"
    (tmp_path / f"{name}.py").write_text(f"def f(x):\n    {imports.format('fast_part').replace(chr(10), '; ')}\n")
    built = tmp_path / f"fast_part{EXTENSION_SUFFIXES[0]}"
    for build in (b"\x7fELF\0one", b"\x7fELF\0two"):
        built.write_bytes(build)
        with (
            nullcontext()
            if build.endswith(b"one")
            else pytest.raises(InputError, match=r"fast_part.*start Python again")
        ):
            one = load_simulator(function=f"{name}:f", folder=StudyFolder(tmp_path))
    assert source_hash(sources_of(name)) != one.source_hash


def test_a_compiled_module_of_another_folder_is_refused(tmp_path, monkeypatch):
    """Regression: that of the folder before, which Python keeps, computed the points in silence."""
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / f"user_in_{folder}.py").write_text("def f(x):\n    import built_twice\n")
        (tmp_path / folder / f"built_twice{EXTENSION_SUFFIXES[0]}").write_bytes(folder.encode())
    load_simulator(function="user_in_one:f", folder=StudyFolder(tmp_path / "one"))
    loaded = ModuleType("built_twice")
    loaded.__file__ = str(tmp_path / "one" / f"built_twice{EXTENSION_SUFFIXES[0]}")
    monkeypatch.setitem(sys.modules, "built_twice", loaded)
    load_simulator(function="user_in_one:f", folder=StudyFolder(tmp_path / "one"))
    with pytest.raises(InputError, match=r"built_twice.*start Python again"):
        load_simulator(function="user_in_two:f", folder=StudyFolder(tmp_path / "two"))


def test_modules_beside_a_script_count(tmp_path, monkeypatch):
    """Regression: of a function in a script, the points of an earlier version of its helper were shown."""
    script, helper = ModuleType("__main__"), tmp_path / "helper_of_script.py"
    script.__file__, script.f = str(tmp_path / "script.py"), lambda x: {"y": x}
    Path(script.__file__).write_text("import helper_of_script\ndef f(x):\n    return {'y': helper_of_script.g(x)}\n")
    helper.write_text("def g(x):\n    return x\n")
    monkeypatch.setitem(sys.modules, "__main__", script)
    first = load_simulator(function="__main__:f")
    assert sources_of("__main__").keys() == {"__main__", "helper_of_script.py"}
    helper.write_text("def g(x):\n    return 2 * x\n")
    with pytest.raises(
        InputError, match=r"helper_of_script.py has changed since it was loaded here: start Python again"
    ):
        load_simulator(function="__main__:f")
    assert source_hash(sources_of("__main__")) != first.source_hash
    another = ModuleType("__main__")  # as %run of IPython makes one
    another.f = script.f
    monkeypatch.setitem(sys.modules, "__main__", another)
    load_simulator(function="__main__:f")


def test_numbers_and_texts_of_one_argument_are_refused(tmp_path):
    """Regression: all points were computed, and no cube could hold them."""
    with pytest.raises(InputError, match="values are numbers and texts; write all as"):
        answer(tmp_path, "echo", '[factors.n]\nvalues = [1, 2.5, "3"]')
