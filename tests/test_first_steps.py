"""The first minutes: a study file to start from, the version, completion, the brief schema, near names."""

from __future__ import annotations

import re
import shutil
import subprocess
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest

import tripod_doe as td
from tripod_doe.cli import main
from tripod_doe.errors import closest
from tripod_doe.study.definition.simulators import load_simulator
from tripod_doe.study.definition.study_file_schema import TABLES
from tripod_doe.study.definition.template import EXAMPLES, TEMPLATES, write_examples

ROOT = Path(__file__).parent.parent


@pytest.mark.parametrize("kind", TEMPLATES)
def test_init_writes_a_study_that_can_be_planned_also_with_all_its_options(kind, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["init", "mine", "--kind", kind]) == 0
    assert capsys.readouterr().out == "mine.toml\n"
    assert td.plan("mine.toml", timing=False).points > 1
    assert kind == "multifidelity" or "vibrates" in td.load_study("mine.toml").keep  # else a verdict may be too good
    text = Path("mine.toml").read_text()
    lines = [line[2:] if re.match(r"# (\w+ = |\[)", line) else line for line in text.splitlines()]
    assert lines != text.splitlines()
    Path("all.toml").write_text("\n".join(lines))
    assert td.plan("all.toml", timing=False).points > 1
    assert main(["init", "mine.toml"]) == 2
    assert "mine.toml: this file exists" in capsys.readouterr().err


def test_init_copies_the_examples_that_pages_name(tmp_path, capsys):
    """Regression: with the wheel alone, no command with `measurements/run_up.csv` could be tried."""
    assert main(["init", str(tmp_path / "new"), "--kind", "examples"]) == 0
    assert "measurements" in capsys.readouterr().out
    there = {path.relative_to(tmp_path / "new") for path in (tmp_path / "new").rglob("*.*")}
    kept = [path for name in EXAMPLES for path in (ROOT / name).rglob("*.*") if path.suffix in (".toml", ".csv")]
    assert there == {path.relative_to(ROOT) for path in [*kept, ROOT / "studies" / "ishigami.py"]}
    assert main(["init", str(tmp_path / "new"), "--kind", "examples"]) == 2
    assert "studies: this folder exists; choose another place" in capsys.readouterr().err


def test_a_wheel_has_all_examples(tmp_path):
    """Regression: the points of a study and the function of another one were left out of wheels or of copies."""
    write_examples(tmp_path)
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["data-files"]
    packed = {path.relative_to(ROOT) for globs in listed.values() for glob in globs for path in ROOT.glob(glob)}
    assert packed == {path.relative_to(tmp_path) for path in tmp_path.rglob("*.*")}


def test_the_version_is_that_of_the_package(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"tripod-doe {version('tripod-doe')}\n"


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_bash_completes_commands_flags_and_parameters(tmp_path, capsys):
    assert main(["completion", "bash"]) == 0
    script = tmp_path / "completion"
    script.write_text(capsys.readouterr().out)
    ask = 'COMP_WORDS=({}); COMP_CWORD={}; _shtab_tripod_doe; echo "${{COMPREPLY[@]}}"'
    for words, place, reply in (
        ("tripod-doe sim", 1, "simulate"),
        ("tripod-doe simulate --joint-an", 2, "--joint-angle-deg"),
    ):
        asked = subprocess.run(
            ["bash", "-c", f"source {script}; " + ask.format(words, place)], capture_output=True, text=True, check=True
        )
        assert asked.stdout.strip() == reply


def test_the_brief_schema_names_every_key_parameter_and_output(capsys):
    assert main(["schema", "study", "--brief"]) == 0
    lines = capsys.readouterr().out.splitlines()
    first = {line.split()[0] for line in lines if line.strip()}
    simulator = load_simulator("joint")
    keys = {name for table in TABLES.values() for name in table.model_fields}
    assert {*keys, *simulator.parameters, *simulator.outputs} <= first


def test_usual_names_of_the_thrust_are_known(capsys):
    """Regression: ten names by letters, as 'trust' for Fx."""
    outputs = load_simulator("joint").outputs
    for usual in ("Fx", "GAF", "axial force", "generated axial force", "axial_force"):
        assert closest(usual, outputs) == "; did you mean 'thrust' or 'thrust_amplitude'?", usual
    assert "thrust" not in closest("Fx", load_simulator("joint").parameters)
    for order in ("F3", "A_2", "order_3", "3rd_order"):
        assert closest(order, outputs) == "; did you mean 'thrust_amplitude'?", order
    assert main(["simulate", "--variable", "GAF"]) == 2
    assert "did you mean 'thrust' or 'thrust_amplitude'?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("wrong", "meant"),
    [
        ("joint_angel_deg", "; did you mean 'joint_angle_deg'?"),
        ("torque", "; did you mean 'torque_n_m'?"),
        ("skew", "; did you mean 'initial_skew_1_deg' or 'initial_skew_2_deg' or 'initial_skew_3_deg'?"),
        ("initial_skew", "; did you mean 'initial_skew_1_deg' or 'initial_skew_2_deg' or 'initial_skew_3_deg'?"),
        ("groove_friction", "; did you mean 'groove_sliding_friction'?"),
        ("groove_mu", "; did you mean 'groove_sliding_friction'?"),
        ("needle_mu", "; did you mean 'needle_sliding_friction'?"),
        ("roller_friction", "; did you mean 'groove_sliding_friction'?"),
        ("friction", "; did you mean 'groove_sliding_friction' or 'needle_sliding_friction'?"),
        ("rolling_friction", "; did you mean 'groove_rolling_friction' or 'needle_rolling_friction'?"),
        ("temperature", ""),
        ("density_x", ""),
    ],
)
def test_only_near_names_are_suggested(wrong, meant):
    assert closest(wrong, load_simulator("joint").parameters) == meant
