"""The command line as a user meets it: answers on standard output, messages on standard error, exit codes."""

from __future__ import annotations

import contextlib
import json
import os
import re
import resource
import runpy
import subprocess
import sys

import numpy as np
import pytest
import xarray as xr

import tripod_doe as td
from tripod_doe.cli import main
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.study import plan

pytestmark = pytest.mark.usefixtures("charts_not_drawn")

STUDY = """
    [study]
    name = "small"
    [factors]
    joint_angle_deg = {values = [5, 10]}
    needle_count = {values = [27, 28]}
    [keep]
    outputs = ["thrust_amplitude", "largest_penetration_um"]
    [run]
    expected_outcomes = ["jammed"]
"""


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    (folder / "study.toml").write_text("\n".join(line[4:] for line in STUDY.splitlines()))
    td.run(folder / "study.toml", out=folder / "out", progress=False)
    return folder / "out"


def call(capsys, *words):
    code = main([str(word) for word in words])
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    return code, captured.out, captured.err


def test_simulate_answers_one_json_object(capsys):
    code, out, _ = call(capsys, "simulate", "--joint_angle_deg", "5", "--torque-n-m=-50", "--format", "json")
    answer = json.loads(out)
    assert code == 0
    assert answer["outcome"] == "finished"
    assert set(answer["parameters"]) == set(JOINT_PARAMETERS)
    assert answer["parameters"]["torque_n_m"] == -50
    assert answer["parameters"]["groove_spin_friction"] == 0.05
    assert len(answer["thrust_amplitude"]) == 13
    assert [len(groove) for groove in answer["groove_thrust_amplitude"]] == [13, 13, 13]
    assert len(answer["thrust"]) == 720
    assert set(answer["cost"]) == {"cpu_seconds", "wall_seconds", "steps", "force_evaluations"}
    assert answer["cost"]["cpu_seconds"] < 0.1
    direct = td.simulate(joint_angle_deg=5, torque_n_m=-50)
    assert answer["thrust_amplitude"] == direct["thrust_amplitude"].values.tolist()


@pytest.mark.slow
def test_simulate_runs_the_full_model(capsys):
    few = ("--needle-count", 9, "--needle-diameter-mm", 5.89, "--spheres-per-needle", 3, "--cycles", 3)
    code, out, _ = call(capsys, "simulate", "--model", "needles", *few, "--format", "json")
    answer = json.loads(out)
    assert (code, answer["outcome"]) == (0, "finished")
    assert answer["parameters"]["method"] == "adaptive-euler"
    third, error = (answer[name][3] for name in ("thrust_amplitude", "thrust_amplitude_error"))
    assert answer["parameters"]["accuracy"] == 0.02
    assert error <= 0.02 * third
    assert 1e-4 < answer["parameters"]["relative_tolerance"] < 1e-2  # that which the run found
    assert answer["thrust_amplitude"][3] == pytest.approx(14.4, abs=0.3)
    assert np.shape(answer["needle_skew_deg"]) == (3, 720)
    assert np.shape(answer["needle_skew_summary_deg"]) == (3, 3, 3)
    assert answer["cost"]["steps"] > 1000
    assert answer["cost"]["cpu_seconds"] < 10


def test_simulate_prints_the_variables_that_are_named_also_those_on_request(capsys):
    words = ("simulate", "--variable", "thrust_amplitude", "--variable", "largest_groove_pressure_mpa")
    code, out, _ = call(capsys, *words)
    assert code == 0
    assert re.search(r"^thrust_amplitude \[N\]$", out, re.MULTILINE)
    assert re.search(r"^largest_groove_pressure_mpa  \d+ MPa$", out, re.MULTILINE)
    assert "thrust_phase_deg" not in out
    _, out, _ = call(capsys, *words, "--format", "json")
    assert set(json.loads(out)) & {"thrust_amplitude", "thrust", "largest_groove_pressure_mpa"} == set(words[2::2])


def test_simulate_takes_the_point_of_a_file_and_flags_come_before_it(capsys, write_study):
    study = write_study(
        "[base]\npitch_radius_mm = 23\ntorque_n_m = 80\n[factors.joint_angle_deg]\nvalues = [5, 6]\n"
        "[factors.speed_rpm]\nvalues = [900]\n"
    )
    words = ("simulate", "--base", str(study), "--torque-n-m", "60")
    code, out, _ = call(capsys, *words, "--joint-angle-deg", "7", "--format", "json")
    used = json.loads(out)["parameters"]
    assert code == 0
    names = ("pitch_radius_mm", "torque_n_m", "joint_angle_deg", "speed_rpm")
    assert [used[name] for name in names] == [23, 60, 7, 900]
    code, _, said = call(capsys, *words)
    assert code == 2
    assert "simulate computes one point, and this file varies: give --joint-angle-deg" in said
    assert "--speed-rpm" not in said


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[base]\npitch_radius = 23\n", "study.toml: [base]: pitch_radius = 23: unknown parameter"),
        ("[study]\nname = 'x'\n", "study.toml: this file has no table [base]"),
        ("[base\n", "study.toml"),
        ("[base]\nmodel = 'auto'\n", "this file varies: give --model"),
        ("[study]\nscene = 'trunnion'\n[base]\nload_n = 3\n", "add --scene trunnion"),
        ("[variables.speed_rpm]\nlow = 3\nhigh = 4\n[at.torque_n_m]\nvalues = [2, 3]\n", "--speed-rpm --torque-n-m"),
        ("[base]\ntorque_n_m = 2\n[unknowns.torque_n_m]\n[unknowns.groove_sliding_friction]\n", "--groove-sliding"),
    ],
)
def test_a_wrong_base_is_named_with_its_file(capsys, write_study, text, message):
    code, _, said = call(capsys, "simulate", "--base", str(write_study(text)))
    assert code == 2
    assert message in said


def test_simulate_that_does_not_finish_exits_3(capsys):
    code, out, _ = call(capsys, "simulate", "--needle-count", "40", "--format", "json")
    assert code == 3
    assert json.loads(out)["outcome"] == "jammed"
    assert json.loads(out)["thrust_amplitude"] is None


def test_simulate_table_is_for_people(capsys):
    code, out, told = call(capsys, "simulate")
    assert code == 0
    assert "thrust_amplitude [N]" in out
    assert "CPU time" not in told


def test_a_long_simulation_tells_its_price_first(capsys):
    """Regression: a joint by `needles` ran for more than a minute without a word."""
    code, out, told = call(capsys, "simulate", "--model", "needles", "--needle-count", "40", "--format", "json")
    assert (code, json.loads(out)["outcome"]) == (3, "jammed")
    assert re.match(r"simulating: about [\d.]+ s of CPU time for a usual point, up to twenty times", told)


def test_query_answers_records(capsys, results):
    code, out, _ = call(
        capsys,
        "query",
        results,
        "--variable",
        "thrust_amplitude",
        "--select",
        "order=2,3",
        "--select",
        "joint_angle_deg=6:",
        "--format",
        "json",
    )
    records = json.loads(out)
    assert code == 0
    assert [(r["joint_angle_deg"], r["needle_count"], r["order"]) for r in records] == [
        (10, 27, 2),
        (10, 27, 3),
        (10, 28, 2),
        (10, 28, 3),
    ]
    assert records[1]["thrust_amplitude"] == pytest.approx(14.43, abs=0.01)
    assert records[3] == {
        "joint_angle_deg": 10.0,
        "needle_count": 28.0,
        "order": 3,
        "thrust_amplitude": None,
        "outcome": "jammed",
    }


def test_query_forms_and_conditions(capsys, results, tmp_path):
    condition = "outcome == 'finished' and largest_penetration_um > 0 and order == 3"
    _, out, _ = call(
        capsys, "query", results, "--variable", "thrust_amplitude", "--where", condition, "--format", "csv"
    )
    assert len(out.strip().splitlines()) == 3
    code, out, _ = call(
        capsys, "query", results, "--variable", "thrust_amplitude", "--select", "joint_angle_deg=7", "--format", "json"
    )
    assert (code, json.loads(out)) == (0, [])
    _, out, _ = call(
        capsys,
        "query",
        results,
        "--variable",
        "outcome",
        "--select",
        "joint_angle_deg=7",
        "--nearest",
        "--format",
        "json",
    )
    assert {r["outcome"] for r in json.loads(out)} == {"finished", "jammed"}
    assert {r["joint_angle_deg"] for r in json.loads(out)} == {5}
    code, _, _ = call(
        capsys, "query", results, "--variable", "cpu_seconds", "--format", "netcdf", "--output", tmp_path / "q.nc"
    )
    assert code == 0
    with xr.open_dataset(tmp_path / "q.nc") as answer:
        assert answer["cpu_seconds"].dims == ("joint_angle_deg", "needle_count")


@pytest.mark.parametrize(
    ("name", "start"),
    [("q.csv", b"joint_angle_deg,"), ("q.JSON", b"[{"), ("q.nc", b"\x89HDF"), ("q.txt", b"joint_angle_deg need")],
)
def test_the_name_of_the_output_decides_its_format(capsys, results, tmp_path, name, start):
    """Regression: q.csv and q.nc held an aligned table."""
    words = ["query", results, "--variable", "outcome", "--output", tmp_path / name]
    assert call(capsys, *words)[0] == 0
    assert (tmp_path / name).read_bytes().startswith(start)
    other = "csv" if name == "q.txt" else "table"
    code, _, err = call(capsys, *words, "--format", other)
    assert code == 2
    assert f"but --format is {other}" in err
    code, _, err = call(capsys, *words[:-1], tmp_path / "q.data")
    assert code == 2
    assert "end the name in .csv" in err


@pytest.fixture(scope="module")
def whole_results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    text = '[study]\nname = "whole"\n[factors.joint_angle_deg]\nvalues = [5, 10]\n'
    (folder / "study.toml").write_text(text)
    td.run(folder / "study.toml", out=folder / "out", progress=False)
    return folder / "out"


@pytest.fixture
def record(whole_results, tmp_path):
    """The model's own waveform at 10 deg over five turns, 4 % larger and 77 deg late, as a measurement."""
    thrust = td.open_cube(whole_results)["thrust"].sel(joint_angle_deg=10).values.reshape(2, 360).mean(axis=0)
    rotation = np.arange(1800)
    table = np.column_stack([rotation, np.tile(1.04 * np.roll(thrust, 77), 5)])
    np.savetxt(tmp_path / "m.csv", table, delimiter=",", header="rotation_deg,thrust_n", comments="")
    return tmp_path / "m.csv"


@pytest.mark.slow
def test_compare_lays_a_measurement_over_a_point(capsys, whole_results, record, tmp_path):
    words = ["compare", whole_results, record, "--select", "joint_angle_deg=10"]
    code, out, err = call(capsys, *words, "--reference_angle=-77", "--format", "json", "--output", tmp_path / "page")
    answer = json.loads(out)
    assert code == 0
    assert answer["amplitude_difference"][3] == pytest.approx(0.04 * answer["model_amplitude"][3], rel=1e-9)
    assert answer["phase_difference_deg"][3] == pytest.approx(0, abs=1e-6)
    assert answer["point"] == {"joint_angle_deg": 10.0}
    assert str(tmp_path / "page" / "index.html") in err
    assert (tmp_path / "page" / "index.html").exists()
    code, out, _ = call(capsys, *words)
    assert code == 0
    assert "no reference angle is given" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "--select 'joint_angle_deg=5|10'"),
        (["--select", "joint_angle_deg=7"], "--nearest"),
        (["--select", "joint_angle_deg=5", "--speeds", "600"], "LOW:HIGH"),
        (["--select", "joint_angle_deg=5", "--speeds", "500:600"], "add a column time_s"),
        (["--select", "joint_angle_deg=5", "--reference-angle", "nan"], "finite angle"),
        (["--select", "joint_angle_deg=5", "--pulses-per-rev", "2"], "did you mean '--pulses-per-revolution'"),
    ],
)
def test_a_bad_comparison_is_refused(capsys, whole_results, record, words, message):
    code, out, err = call(capsys, "compare", whole_results, record, *words)
    assert (code, out) == (2, "")
    assert message in err


@pytest.mark.slow
def test_plan_counts_and_writes_nothing(capsys, write_study, tmp_path, monkeypatch):
    """`study/test_plan.py` times points."""
    monkeypatch.setattr(plan, "time_points", lambda study, seconds: [0.002])
    study = write_study(STUDY)
    before = sorted(tmp_path.iterdir())
    code, out, _ = call(capsys, "plan", study, "--no-timing")
    assert code == 0
    assert "points       4" in out
    code, out, _ = call(capsys, "plan", study)
    assert "CPU time" in out
    assert sorted(tmp_path.iterdir()) == before


def test_schema_holds_every_parameter(capsys):
    _, out, _ = call(capsys, "schema", "study")
    schema = json.loads(out)
    assert set(schema["properties"]["base"]["properties"]) == set(JOINT_PARAMETERS)
    assert "designs" not in schema["properties"]  # a file writes [design.NAME]
    assert schema["properties"]["design"]["additionalProperties"] == {"$ref": "#/$defs/DesignTable"}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["simulate", "--joint-angel-deg", "5"], "did you mean '--joint-angle-deg'"),
        (["simulate", "--temperature", "5"], "unknown flag --temperature\ntry: tripod-doe simulate --help"),
        (["simulate", "--joint-angle-deg", "steep"], "expected a number"),
        (["simulate", "--joint-angle-deg", "nan"], "must be finite"),
        (["simulate", "--joint-angle-deg", "60"], "must be >= 0 and <= 40"),
        (["simulate", "--variable", "thrust_amp"], "did you mean 'thrust_amplitude'"),
        (["simulate", "--model", "needels"], "did you mean 'needles'"),
        (["simulate", "--model", "beams"], "allowed: equilibrium, kinetostatic, rollers, needles"),
        (["simulate", "--step-s", "1e-5"], "not used by newton (kinetostatic)"),
        (["simulate", "--model", "needles", "--method", "newton"], "not a method of needles"),
        (["simulate", "--scene", "jiont"], "did you mean 'joint'"),
        (["run", "nowhere.toml", "--out", "x"], "cannot read"),
        (["run", "{study}"], "--out"),
        (["run", "{study}", "--out", "/proc/nowhere"], "cannot make this directory"),
        (["run", "{study}", "--out", "{file}"], "cannot make this directory"),
        (["run", "{study}", "--out", "{out}", "--workers", "-1"], "must be 0 (this process) or more"),
        (["run", "{study}", "--out", "{out}", "--workers", "many"], "--workers: 'many': expected a whole number"),
        (["run", "{study}", "--out", "{out}", "--workers", "1_0"], "--workers: '1_0': expected a whole number"),
        (["run", "{study}", "--out", "{out}", "--workers", "1.5"], "--workers: '1.5': expected a whole number"),
        (["plan", "{study}", "--workers", "1_000"], "--workers: '1_000': expected a whole number"),
        (["serve", "--port", "8_811"], "--port: '8_811': expected a whole number"),
        (["compare", "x.nc", "y.csv", "--reference-angle", "1_0"], "--reference-angle: '1_0': expected a number"),
        (["plan", "{bad}"], "did you mean 'torque_n_m'"),
        (["query", "{out}", "--variable", "y"], "there is no such file"),
        (["query", "{empty}", "--variable", "y"], "no cube.nc"),
        (["query", "{truncated}", "--variable", "y"], "cut.nc: damaged: its content does not match its checksum"),
        (["query", "{results}", "--variable", "thrust_amplitud"], "did you mean 'thrust_amplitude'"),
        (
            ["query", "{results}", "--variable", "outcome", "--select", "joint_angle=5"],
            "did you mean 'joint_angle_deg'",
        ),
        (["query", "{results}", "--variable", "outcome", "--select", "joint_angle_deg"], "name=value"),
        (["query", "{results}", "--variable", "outcome", "--where", "import os"], "not an expression"),
        (["query", "{results}", "--variable", "outcome", "--format", "netcdf"], "--output"),
        (["report", "{empty}"], "no cube.nc"),
        (["plan", "{analysis}"], "sobol needs a design of kind saltelli"),
        (["schema", "studdy"], "invalid choice: 'studdy'; did you mean 'study'? allowed: study, workflow"),
        (["simulat"], "did you mean 'simulate'"),
        (["report", "{results}", "all"], "unexpected argument 'all'"),
        (["fly"], "invalid choice: 'fly'; allowed: run, plan"),
        ([], "required"),
    ],
)
def test_bad_calls_are_refused_and_start_nothing(capsys, write_study, tmp_path, results, words, message):
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").write_text("")
    (tmp_path / "cut.nc").write_bytes((results / "cube.nc").read_bytes()[:3000])
    places = {
        "study": write_study(STUDY),
        "analysis": write_study(STUDY + "[analysis.sobol]\n", "analysis.toml"),
        "bad": write_study('[study]\nname="b"\n[base]\ntorque_nm = 5\n', "bad.toml"),
        "out": tmp_path / "out",
        "file": tmp_path / "file" / "below",
        "empty": tmp_path / "empty",
        "truncated": tmp_path / "cut.nc",
        "results": results,
    }
    code, out, err = call(capsys, *[word.format(**places) for word in words])
    assert code == 2
    assert out == ""
    assert message in err
    assert not (tmp_path / "out").exists() or words[0] == "run"


def test_a_damaged_cube_is_rebuilt_from_the_journal(capsys, results):
    whole = (results / "cube.nc").read_bytes()
    (results / "cube.nc").write_bytes(whole[:5000])
    code, _, err = call(capsys, "query", results, "--variable", "thrust_amplitude")
    assert code == 2
    assert "run the study again" in err
    code, _, err = call(capsys, "run", results / "study.toml", "--out", results)
    assert code == 0
    assert "0 points computed, 4 reused" in err
    assert np.isfinite(td.open_cube(results)["thrust_amplitude"].sel(joint_angle_deg=10, needle_count=27)).all()


def test_the_terminal_prints_the_findings_of_the_analyses_that_a_study_asks_for(capsys, write_study, tmp_path):
    (tmp_path / "two.py").write_text("def f(x, z):\n    return {'y': 3 * x + z + x * z}\n")
    study = write_study(
        '[study]\nname="s"\nfunction="two:f"\n[factors]\nx={low=0,high=1}\nz={low=0,high=1}\n[design]\n'
        'kind="saltelli"\nsamples=64\n[analysis.sobol]\n'
    )
    code, out, err = call(capsys, "run", study, "--workers", 0, "--out", tmp_path / "out")
    assert (code, out) == (0, "")
    first, *others = err.splitlines()
    assert first.startswith("Total Sobol' indices of y: x 0.8")
    assert "+-" in first
    assert any(line.startswith("64 samples are not enough for y") for line in others)
    assert any(line.startswith("y lies between") for line in others)
    assert "\r" not in err
    assert re.search(r"\n256 points computed in [\d.]+ [mu]?s \([\d,.]+ points per second\), 0 reused\n", err)


def limited(bytes_):
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (bytes_, bytes_))


@pytest.mark.slow
def test_a_full_disk_loses_nothing(write_study, tmp_path):
    """The file size limit stands in for a full disk: writes fail in mid-run."""
    (tmp_path / "wide.py").write_text("import numpy as np\ndef f(x):\n    return {'y': np.full(20000, x)}\n")
    study = write_study('[study]\nname="w"\nfunction="wide:f"\n[factors.x]\nlow=0\nhigh=1\ncount=60\n[run]\nblock=4\n')
    command = [
        sys.executable,
        "-m",
        "tripod_doe.cli",
        "run",
        str(study),
        "--out",
        str(tmp_path / "out"),
        "--workers",
        "0",
    ]
    stopped = subprocess.run(command, preexec_fn=limited(3_000_000), capture_output=True, text=True, env=os.environ)
    assert stopped.returncode == 1, stopped.stderr
    assert "finished points are kept" in stopped.stderr
    assert "Traceback" not in stopped.stderr
    summary = td.run(study, out=tmp_path / "out", workers=0, progress=False)
    assert summary.good
    assert summary.reused > 0
    assert summary.computed + summary.reused == 60


def test_the_package_is_the_command_too(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["python", "--version"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_module("tripod_doe", run_name="__main__")
    assert ended.value.code in (0, None)
    assert capsys.readouterr().out.startswith("tripod-doe ")


def test_variables_of_a_query_stand_beside_each_other(capsys, tmp_path):
    """Regression: the first one was dropped in silence, then a second one refused."""
    study = {
        "study": {"name": "two"},
        "base": {"model": "equilibrium"},
        "factors": {"joint_angle_deg": {"values": [4, 8]}},
    }
    td.run(study, out=tmp_path / "out", workers=0, progress=False)
    asked = ["query", str(tmp_path / "out"), "--variable"]
    both = [*asked, "trust", "--variable", "thrust_amplitude", "--select", "order=2,3", "--format", "json"]
    assert main(both) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [*rows[0]] == ["joint_angle_deg", "order", "trust", "thrust_amplitude", "outcome"]
    assert main([*asked, "thrust_amplitude", "--select", "order=2,3", "--format", "json"]) == 0
    assert [{name: row[name] for name in row if name != "trust"} for row in rows] == json.loads(capsys.readouterr().out)
    assert main([*both[:-2], "--output", str(tmp_path / "both.nc")]) == 0
    with xr.open_dataset(tmp_path / "both.nc") as answer:
        assert {"trust", "thrust_amplitude"} <= set(answer.data_vars)
    assert main([*asked, "thrust_amplitude", "--variable", "thrust"]) == 2
    assert "thrust lies along joint_angle_deg, rotation_deg: query each by itself" in capsys.readouterr().err


def test_many_names_are_not_listed_in_a_message(capsys):
    """Regression: an unknown output listed all 46."""
    assert main(["simulate", "--variable", "unknown"]) == 2
    error = capsys.readouterr().err
    assert error.count(", ") == 9
    assert "; the most similar of " in error


def test_an_empty_file_says_which_table_is_missing(tmp_path, capsys):
    """Regression: "the file: study is missing"."""
    (tmp_path / "empty.toml").write_text("")
    assert main(["plan", str(tmp_path / "empty.toml")]) == 2
    assert "empty.toml: the file: table [study] is missing" in capsys.readouterr().err


def test_times_may_end_with_m_or_min(tmp_path, capsys):
    """Regression: 5m was refused where 5min was taken."""
    for time, complaint in (("5m", "none.toml"), ("5min", "none.toml"), ("5 parsecs", "write a time such as 90")):
        with contextlib.suppress(SystemExit):
            main(["run", str(tmp_path / "none.toml"), "--out", str(tmp_path / "out"), "--wait", time])
        assert complaint in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["simulate"], "interrupted\n"),
        (
            ["run", "a.toml", "--out", "a"],
            "interrupted; finished points are kept: run again to continue, or report DIR",
        ),
        (["workflow", "a.toml", "--out", "a"], "interrupted; finished points are kept: run again to continue\n"),
    ],
)
def test_an_interrupt_says_what_is_kept(capsys, monkeypatch, words, said):
    """Regression: also of a command that keeps no points, and with a report that a workflow does not have yet."""

    def interrupt(options):
        raise KeyboardInterrupt

    monkeypatch.setattr(sys.modules["tripod_doe.cli.main"], "_ran", interrupt)
    assert main(words) == 130
    assert f"tripod-doe: {said}" in capsys.readouterr().err
