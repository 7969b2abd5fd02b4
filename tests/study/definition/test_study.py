"""Study files: what is wrong is named with file, key, value and remedy."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import pytest

from tripod_doe.errors import InputError
from tripod_doe.study.definition.study_file import load_study, parse_study
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.designs import make_points
from tripod_doe.study.result_directory.stored_study import ResultFolder

HEAD = '[study]\nname = "d"\n'
FACTOR = "[factors]\njoint_angle_deg = {values = [5, 10]}\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[study", "not valid TOML"),
        ("[base]\n", r"my.toml: the file: table \[study\] is missing"),
        ('[study]\nname="a"\nscene="joynt"', "did you mean 'joint'"),
        ('[study]\nname="a"\nquestoin="?"', r"\[study\]: unknown key 'questoin'; did you mean 'question'"),
        ('[study]\nname="a"\nfunction="math"', "package.module:function"),
        ('[study]\nname="a"\nfunction="no_such_module:f"', "cannot import"),
        ('[study]\nname="a"\nfunction="math:sinn"', "no sinn in math"),
        (HEAD + "[bse]\n", "did you mean 'base'"),
        (HEAD + "[base]\ntorque_nm = 5", "did you mean 'torque_n_m'"),
        (HEAD + '[base]\ntorque_n_m = "much"', "torque_n_m = 'much': expected a number"),
        (HEAD + "[base]\ntorque_n_m = nan", "must be finite"),
        (HEAD + "[base]\njoint_angle_deg = 60", r"must be >= 0 and <= 40 deg"),
        (HEAD + "[base]\nneedle_count = 27.5", "whole number"),
        (HEAD + "[base]\ngroove_sliding = 2", "0 or 1"),
        (
            HEAD + '[base]\nmodel = "equilibrum"',
            r"did you mean 'equilibrium'\? allowed: equilibrium, kinetostatic, rollers, needles",
        ),
        (HEAD + "[base]\nzzz = 5", "zzz = 5: unknown parameter; the most similar of 55 names: "),
        (HEAD + "[base]\nstep_s = 1e-5\n" + FACTOR, r"\[base\]: step_s = 1e-05: not used by newton \(kinetostatic\)"),
        (HEAD + FACTOR + "[base]\njoint_angle_deg = 5", "both a base value and a factor"),
        (HEAD + FACTOR + "[factors.joint_angle_deg]\nvalues=[1]", "not valid TOML"),
        (HEAD + "[factors.joint_angle_deg]\nvalues = []", "values is empty"),
        (HEAD + "[factors]\njoint_angle_deg = [5, 10]", r"write joint_angle_deg = \{ values = \[5, 10\] \}"),
        (HEAD + "[factors]\njoint_angle_deg = 5", r"a parameter with one value belongs in \[base\]"),
        (HEAD + FACTOR + "[analysis]\neffects = 3", r"expected a table, as \[analysis.effects\]"),
        (HEAD + "[factors.joint_angle_deg]\nlow = true\nhigh = 9\ncount = 3", "low = true: expected a number"),
        (HEAD + "[strue]", "the file: unknown key 'strue'"),
        (HEAD + "[factors.str]\nvalues = 3", r"\[factors.str\]: values = 3: expected a list"),
        (HEAD + "[factors.x]\nint = 3", r"\[factors.x\]: unknown key 'int'"),
        (HEAD + "[base]\nint = [[3]]", r"\[base\]: int = \[\[3\]\]: expected a number"),
        ("study = 3", r"expected a table, as \[study\]"),
        (HEAD + "[factors.joint_angle_deg]\nvalues = 5", r"values = 5: expected a list, as values = \[5\]"),
        (HEAD + "[factors.joint_angle_deg]\ndistribution = 'normal'\nmean = 5\nstd = -2", "std = -2: must be above 0"),
        ("[study]\nname = ''", "name = '': must not be empty"),
        (
            HEAD + f'question = "{"x" * 3_000_000}"',
            "question = .*: must have at most 4,000 characters",
        ),  # in each list of runs
        (f'[study]\nname = "{"x" * 201}"', "name = .*: must have at most 200 characters"),
        (
            HEAD + FACTOR + "[designs.a]\nkind = 'grid'",
            r"unknown key 'designs'; a sub-design is written \[design.NAME\]",
        ),
        (HEAD + "[factors.joint_angle_deg]\nlow = 5", "needs high"),
        (HEAD + "[factors.joint_angle_deg]\nlow = 9\nhigh = 5\ncount = 2", "must be below"),
        (HEAD + "[factors.joint_angle_deg]\nvalues = [1]\nlow = 5", "not both"),
        (
            HEAD + "[factors.joint_angle_deg]\ndistribution = 'gauss'",
            "distribution = 'gauss': unknown; allowed: uniform, normal",
        ),
        (
            HEAD + "[factors.joint_angle_deg]\nlow = 1\nhigh = 5\ndistribution = 'uniform'\nscale = 'log'",
            "not use scale",
        ),
        (HEAD + "[factors.needle_count]\ndistribution = 'normal'\nmean = 27\nstd = 2", "takes whole numbers"),
        (HEAD + "[factors.joint_angle_deg]\ndistribution = 'normal'\nmean = 5", "needs std"),
        (HEAD + "[factors.speed_rpm]\nlow = 0\nhigh = 5\ncount = 3\nscale = 'log'", "logarithmic"),
        (HEAD + FACTOR + "[design]\nkind = 'gird'", r"\[design\]: kind = 'gird': unknown; did you mean 'grid'\?"),
        (HEAD + FACTOR + "[keep]\noutputs = ['thrust_amplitud']", "did you mean 'thrust_amplitude'"),
        (HEAD + FACTOR + "[run]\nexpected_outcomes = ['jamed']", "did you mean 'jammed'"),
        (HEAD + FACTOR + "[run]\nblock = 0", "block = 0"),
        (HEAD + "[factors.samples_per_revolution]\nvalues = [360, 720]", "different lengths"),
    ],
)
def test_mistakes_are_named(text, message):
    with pytest.raises(InputError, match=message) as caught:
        parse_study(text, origin="my.toml")
    assert str(caught.value).startswith("my.toml")


def test_all_names_and_base_values_that_are_wrong_are_told_at_once():
    text = (
        HEAD + "[base]\npitch_radius = 23\nneedle_count = 27.5\nspeed_rpm = 60\n[factors]\ntorque = { values = [1] }\n"
    )
    with pytest.raises(InputError) as caught:
        parse_study(text, "mine.toml")
    places = [line.split(": ")[:2] for line in str(caught.value).splitlines()]
    assert places == [["mine.toml", "[base]"], ["mine.toml", "[base]"], ["mine.toml", "[factors.torque]"]]


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        ("[design]\nsample = 3\n", "[design]: unknown key 'sample'; did you mean 'samples'?"),
        ("[keep]\noutputs = 'thrust'\n", "[keep]: outputs = 'thrust': expected a list, as outputs = ['thrust']"),
    ],
)
def test_names_that_are_wrong_are_told_with_what_is_wrong_in_form(wrong, complaint):
    """At once, and nothing that is only wrong in form a second time."""
    text = HEAD + wrong + "[base]\nspeed = 60\nmodel = 'auto'\n[factors]\ntorque = { values = [1] }\n"
    with pytest.raises(InputError) as caught:
        parse_study(text, "mine.toml")
    form, base, factor = str(caught.value).splitlines()
    assert form == f"mine.toml: {complaint}"
    assert base == "mine.toml: [base]: speed = 60: unknown parameter; did you mean 'speed_rpm'?"
    assert factor.startswith("mine.toml: [factors.torque]: unknown parameter; did you mean")


GRID = "[factors]\njoint_angle_deg = {values = [5, 10]}\ntorque_n_m = {values = [200, 300]}\n"
PRODUCT = f"{GRID}[design]\nkind = 'product'\nof = ['a', 'b']\n[design.b]\nfactors = ['torque_n_m']\n[design.a]\n"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            f"{GRID}[design]\nsamples = 4\nsplit = {{a = 3}}\n",
            r"samples, split: not used by kind = \"grid\"; leave it out",
        ),
        (f"{GRID}[design]\nfactors = ['joint_angle_deg']\n", r"factors leaves out torque_n_m; add it, or leave out"),
        (f"{GRID}[design.c]\n", r"\[design.c\]: no design uses it: only kind = \"product\" has sub-designs"),
        (f"{PRODUCT}factors = ['joint_angle_deg']\n[design.c]\n", r"\[design.c\]: no design uses it: add it to of"),
        (
            f"{PRODUCT}factors = ['joint_angle_deg']\nconstraints = ['joint_angle_deg < 7']\n",
            r"\[design.a\]: constraints belong to all points; move them to \[design\]",
        ),
        (f"{PRODUCT}factors = ['joint_angle_deg']\nseed = 3\n", r"\[design.a\]: seed: not used by kind = \"grid\""),
        (
            "[factors]\ntorque_n_m = {values = [5], distribution = 'normal', mean = 9, std = 1}\n",
            r"\[factors.torque_n_m\]: values and distribution, mean, std: give either levels or a distribution",
        ),
        ("[factors]\ntorque_n_m = {low = 5, high = 6, count = 3, std = 1}\n", r"\[factors.torque_n_m\]: count and std"),
    ],
)
def test_what_no_design_reads_is_refused(text, told):
    """Regression: other points than the file asks for, without a word."""
    with pytest.raises(InputError, match=told):
        parse_study(HEAD + text, "mine.toml")
    assert parse_study(HEAD + text, folder=ResultFolder(Path(), False))  # it ran once


def test_a_table_with_other_values_than_its_factors_is_refused(tmp_path):
    """Regression: the values of [factors.PARAMETER] were dropped for those of the table."""
    (tmp_path / "t.csv").write_text("torque_n_m\n50\n60\n")
    for listed in ("values = [50, 70]", "low = 1, high = 99"):
        text = f"{HEAD}[factors]\ntorque_n_m = {{{listed}}}\n[design]\nkind = 'table'\ntable = 't.csv'\n"
        with pytest.raises(InputError, match=r"\[factors.torque_n_m\]: the table has torque_n_m = [56]0"):
            make_points(parse_study(text, folder=StudyFolder(tmp_path)))


def test_what_no_simulator_can_judge_is_told_by_its_form_alone():
    for study in ("scene = 'nowhere'", "function = 'no_module:f'"):
        with pytest.raises(InputError) as caught:
            parse_study(f"[study]\nname = 'a'\n{study}\n[base]\nspeed = 60\n[design]\nsample = 3\n", "mine.toml")
        assert str(caught.value) == "mine.toml: [design]: unknown key 'sample'; did you mean 'samples'?"


def test_a_file_with_a_byte_order_mark_is_read(tmp_path):
    """Regression: "not valid TOML: Invalid statement (at line 1, column 1)", of a file that Notepad has saved."""
    (tmp_path / "mine.toml").write_text(HEAD + FACTOR, encoding="utf-8-sig")
    assert load_study(tmp_path / "mine.toml").file.study.name == "d"


def test_a_file_that_is_not_there(tmp_path):
    (tmp_path / "thrust_map.toml").touch()
    with pytest.raises(
        InputError, match="cannot read the study file: No such file or directory; did you mean 'thrust_"
    ):
        load_study(tmp_path / "thrust_mapp.toml")


def test_a_factor_that_the_model_ignores_is_named():
    study = parse_study(HEAD + "[factors]\nshaft_length_mm = {values = [300, 400]}")
    assert "does not change" in study.warnings[0] or "same thrust" in study.warnings[0]


def test_functions_get_their_arguments_checked(tmp_path):
    (tmp_path / "my_function.py").write_text("def f(x, y=2):\n    return {'z': x * y}\n")
    text = '[study]\nname="f"\nfunction="my_function:f"\n'
    study = parse_study(text + "[factors]\nx={values=[1, 2]}", folder=StudyFolder(tmp_path))
    assert list(study.simulator.parameters) == ["x", "y"]
    with pytest.raises(InputError, match="needs x"):
        make_points(parse_study(text + "[factors]\ny={values=[1, 2]}", folder=StudyFolder(tmp_path)))
    # regression: a column of a table needed an empty [factors.x]
    (tmp_path / "xs.csv").write_text("x\n3\n5\n")
    table = parse_study(text + "[design]\nkind = 'table'\ntable = 'xs.csv'", folder=StudyFolder(tmp_path))
    assert make_points(table).columns["x"].tolist() == [3, 5]


@pytest.mark.parametrize(
    "text",
    [
        "a." * 20_000 + "a = 1",
        '"a" . ' * 10_000 + "a = 1",
        "[" + "a." * 20_000 + "a]",
        "[analysis]\nx = {" + "a." * 10_000 + "a = 1}",
        "[base]\nx = " + "[" * 900 + "]" * 900,
        "[analysis]\nx = " + "{a = " * 900 + "1" + "}" * 900,
        "[[factors.x]]\n" * 5000,
    ],
)
def test_files_that_only_cost_time_are_refused_in_a_sentence(text):
    """Regression: tomllib took 13 s for 40 kB of dotted names, and nested brackets ended in a RecursionError."""
    started = time.perf_counter()
    with pytest.raises(InputError) as refused:
        parse_study('[study]\nname = "deep"\n' + text)
    assert time.perf_counter() - started < 3
    assert len(str(refused.value)) < 300


def test_names_with_dots_in_a_text_are_no_keys():
    words = "a_word-with/slashes "
    study = parse_study(f'[study]\nname = "text"\nquestion = "{words * 190}"\n# {words * 5_000}\n')
    assert study.file.study.name == "text"


def test_a_function_is_refused_from_the_text_before_anything_is_imported(tmp_path):
    (tmp_path / "harmful.py").write_text("raise SystemExit('imported')\n")
    text = '[study]\nname = "h"\nfunction = "harmful:f"\n'
    with pytest.raises(InputError, match="functions are not allowed here"):
        parse_study(text, folder=StudyFolder(tmp_path, trusted=False))
    assert str(tmp_path) not in sys.path
