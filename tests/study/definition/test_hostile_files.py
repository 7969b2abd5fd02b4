"""Study and workflow files from strangers: a clear message or a study, soon, and nothing read or written elsewhere."""

from __future__ import annotations

import os
import time

import numpy as np
import pytest
import tomlkit
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tripod_doe.errors import InputError
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.definition.study_file_schema import DesignTable, FactorTable
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.designs import make_points, point_count
from tripod_doe.workflow.analyses import check_analyses
from tripod_doe.workflow.workflow import load_workflow

_SOON = 5.0  # seconds of CPU time
_POINTS = 20_000  # that a stranger may ask for: more would take longer than a test
LONG = "a" * 5000
TEXTS = [
    "",
    ".",
    "../x",
    "/etc/passwd",
    "\x1b]0;x\x07",
    "\x00",
    "=cmd|x",
    "a\nb",
    "\u202e",
    LONG,
    "CON",
    "auto",
    "e:f",
    "1e3",
]
NUMBERS = [0, -1, 1, 2, 3, 8, 2**31, 2**32, 2**63, 10**18, 10**399, -(10**399), 0.5, 1e-300, 1e300, 5e-324]
ODD = [float("nan"), float("inf"), -float("inf"), True, [], {}, [1, "a"], [[]], {"a": {"b": 1}}]
hostile = st.one_of(
    *map(st.sampled_from, (TEXTS, NUMBERS, ODD)), st.text(max_size=20), st.lists(st.sampled_from(NUMBERS), max_size=3)
)

KINDS = list(DesignTable.model_json_schema()["properties"]["kind"]["enum"])
ANALYSES = ["sobol", "morris", "effects", "surrogate", "tolerance", "pawn", "shapley", "contribution"]
GOOD = {
    "study": {"name": "n"},
    "base": {"model": "equilibrium"},
    "factors": {
        "joint_angle_deg": {"low": 2.0, "high": 12.0},
        "torque_n_m": {"values": [10, 20]},
        "speed_rpm": {"distribution": "truncated-normal", "mean": 500, "std": 100, "low": 100, "high": 900},
    },
}
PLACES = [
    *(("design", key) for key in DesignTable.model_fields),
    *(("factors", "joint_angle_deg", key) for key in FactorTable.model_fields),
    *(("factors", "speed_rpm", key) for key in FactorTable.model_fields),
    *(("base", name) for name in ("torque_n_m", "model", "needle_count", "cycles", "accuracy", "\x1b[2J", "step_s")),
    *(("study", key) for key in ("name", "question", "scene", "function")),
    *(("run", key) for key in ("block", "retry", "expected_outcomes", "exclusive")),
    *(("accuracy", key) for key in ("thrust_amplitude_3", "floor", "confidence", "budget_cpu_s", "x")),
    ("keep", "outputs"),
    *(("analysis", kind, key) for kind in ANALYSES for key in ("outputs", "confidence", "seed", "x")),
    ("analysis", "../../x", "kind"),
    ("design", "../part", "kind"),
    ("\x1b[31m", "x"),
]


def put(document, place, value):
    """Set a value in nested tables; what is no table on the way becomes one."""
    for key in place[:-1]:
        if not isinstance(document.get(key), dict):
            document[key] = {}
        document = document[key]
    document[place[-1]] = value


def copied(table):
    return {key: copied(value) if isinstance(value, dict) else value for key, value in table.items()}


def judged(read):
    """What reading gave: None for a message; that it comes soon and can be read is checked."""
    started = time.process_time()  # other work on the machine does not count
    try:
        answer = read()
    except InputError as error:
        answer, message = None, str(error)
        assert message
        assert all(line.isprintable() for line in message.split("\n"))
        assert len(message) < 100_000
    assert time.process_time() - started < _SOON
    return answer


def text_of(document):
    """The document as TOML; tomlkit does not write all that a text can hold."""
    try:
        return tomlkit.dumps(document)
    except (ValueError, TypeError):
        return None


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    for kind in KINDS:  # imports
        judged(
            lambda kind=kind: make_points(parse_study(tomlkit.dumps(GOOD | {"design": {"kind": kind, "samples": 4}})))
        )
    return tmp_path_factory.mktemp("upload")


changes = st.lists(st.tuples(st.sampled_from(PLACES), hostile), min_size=1, max_size=3)


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(kind=st.sampled_from(KINDS), samples=st.sampled_from([None, 4, 8, 64]), changes=changes)
def test_a_hostile_study_ends_in_a_message_or_in_points(folder, kind, samples, changes):
    document = copied(GOOD)
    document["design"] = {"kind": kind, **({"samples": samples} if samples else {})}
    for place, value in changes:
        put(document, place, value)
    text = text_of(document)
    if text is None:
        return

    def read():
        study = parse_study(text, "study", StudyFolder(folder, trusted=False, most_points=_POINTS))
        check_analyses(study)
        assert point_count(study) >= 0
        return make_points(study)

    points = judged(read)
    if points is not None:
        assert points.count <= 10 * _POINTS
        for column in points.at(slice(0, 1000)).values():
            assert column.dtype == object or np.isfinite(column.astype(float)).all()
    assert os.listdir(folder) == []


@settings(max_examples=100, deadline=None)
@given(st.text(max_size=200))
def test_any_text_is_read_or_refused(text):
    judged(lambda: parse_study(text))
    judged(lambda: parse_study('[study]\nname = "x"\n' + text))


@pytest.mark.parametrize(
    "text",
    [
        'a = "' + '\\"' * 65_536,
        '"' + '\\"' * 65_536,
        "".join(f"[t{i}]\n" for i in range(4_000)),
        "".join(f"[t{i}]\n" for i in range(25_000)),
        "".join(f"[factors.t{i}]\n" for i in range(10_000)),
        "[base]\n" + "".join(f"t{i} = 1\n" for i in range(20_000)),
        "[design]\n" + "".join(f"t{i} = 1\n" for i in range(20_000)),
        "[base]\nmodel = '" + "a" * 200_000 + "'\n",
        "[factors." + "a" * 200_000 + "]\n",
        "[base]\nspeed_rpm = " + "9" * 100_000,
        "[base]\nspeed_rpm = " + "[" * 500 + "]" * 500,
    ],
    ids=range(11),
)
def test_long_texts_take_time_as_long_as_they_are(folder, text):
    assert judged(lambda: parse_study('[study]\nname = "x"\n' + text)) is None


@pytest.mark.parametrize("name", ["../../x", "/tmp/x", "a/b", ".x", "", "\x1b[2J", "NUL", LONG])
@pytest.mark.parametrize("table", ["analysis.{}", "design.{}", "steps.{}"])
def test_names_that_would_be_paths_are_refused_where_files_are_read(tmp_path, table, name):
    document = copied(GOOD) if "steps" not in table else {"workflow": {"name": "w"}}
    put(
        document, (table.partition(".")[0], name), {"kind": "study" if "steps" in table else "sobol", "study": "s.toml"}
    )
    (tmp_path / "file.toml").write_text(tomlkit.dumps(document), encoding="utf-8")
    read = load_workflow if "steps" in table else lambda path: parse_study(path.read_text(encoding="utf-8"))
    with pytest.raises(InputError, match="not a name for a"):
        read(tmp_path / "file.toml")
    assert judged(lambda: read(tmp_path / "file.toml")) is None


@pytest.mark.parametrize("number", ["0x" + "f" * 4000, "0o" + "7" * 6000, "0b" + "1" * 20_000, "9" * 4000, "9" * 5000])
@pytest.mark.parametrize("place", ["[base]\njoint_angle_deg = {}", "[design]\nsamples = {}", "[x]\ny = [[{}]]"])
def test_whole_numbers_of_thousands_of_digits_are_refused(number, place):
    """Python writes no such number: messages that repeated them ended in internal errors."""
    text = f'[study]\nname = "a"\n{place.format(number)}\n'
    with pytest.raises(InputError, match=r"a whole number .*; write a number beyond 1e38 with") as refused:
        parse_study(text, "study.toml", StudyFolder("."))
    assert "set_int_max_str_digits" not in str(refused.value)


@pytest.mark.parametrize("line", ["[design]\nsamples = true", "[factors.x]\nlow = false", "[run]\nblock = true"])
def test_a_switch_is_no_number(line):
    """Python's true is 1."""
    with pytest.raises(InputError, match=r"= (true|false): expected a (whole )?number"):
        parse_study(f'[study]\nname = "a"\n{line}\n', "study.toml", StudyFolder("."))
