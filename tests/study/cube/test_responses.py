"""Responses: variables of a cube by formula, their errors, and what a formula may not say."""

from __future__ import annotations

import textwrap

import numpy as np
import pytest
import tomlkit

import tripod_doe as td
from tripod_doe.errors import InputError
from tripod_doe.study.definition.study_file import parse_study

pytestmark = pytest.mark.usefixtures("pages_not_made")

WAVE = """
import numpy as np, xarray as xr
def wave(a, b=0.0):
    if a == 3:
        raise ValueError("no answer")
    angle = np.arange(0, 360, 90)
    return xr.Dataset(
        {"force": ("angle", a * np.array([0.0, 1.0, 0.0, -2.0]), {"units": "N"}), "size": ((), a),
         "size_error": ((), 0.01 * a), "parts": (("part", "angle"), np.full((2, 4), a))},
        coords={"angle": angle, "part": ["left", "right"]},
    )
"""


@pytest.fixture
def wave(tmp_path, monkeypatch):
    """Runs a study of the function with some responses, for a = 1, 2, 3, of which the last one fails."""
    (tmp_path / "wave_of_responses.py").write_text(WAVE)
    monkeypatch.syspath_prepend(tmp_path)

    def run(formulas, extra="", out="out"):
        study = {
            "study": {"name": "wave", "function": "wave_of_responses:wave"},
            "factors": {"a": {"values": [1, 2, 3]}},
            "responses": {name: {"formula": formula} for name, formula in formulas.items()},
        }
        file = tmp_path / "wave.toml"
        file.write_text(tomlkit.dumps(study) + extra)
        td.run(file, tmp_path / out, workers=0, progress=False)
        return td.open_cube(tmp_path / out)

    return run


@pytest.mark.parametrize(
    ("formula", "expected"),
    [
        ("max(abs(force))", [2, 4]),
        ("min(force)", [-2, -4]),
        ("2 * a", [2, 4]),  # no output: a point that failed has no value all the same
        ("force[90]", [1, 2]),
        ("max(force[0:180])", [1, 2]),
        ("max(force[180:]) - min(force[:180])", [0, 0]),
        ("sqrt(mean(force**2))", np.sqrt(5 / 4) * np.array([1, 2])),
        ("20 * log10(size / 0.001)", 20 * np.log10([1e3, 2e3])),
        ("sum(parts)", [8, 16]),
        ("sum(parts['left', :])", [4, 8]),
        ("max(sum(parts, 'part'))", [2, 4]),
        ("max(size, 1.5)", [1.5, 2]),
        ("size * a + b", [1, 4]),
        ("(size > 1) + 1", [1, 2]),
    ],
)
def test_formulas(wave, formula, expected):
    """Exact: by hand. A point that failed has no value, also where a comparison would be false."""
    cube = wave({"r": formula})
    assert cube["r"].values == pytest.approx([*expected, np.nan], nan_ok=True)
    assert cube["r"].dims == ("a",)
    assert cube["r"].attrs["formula"] == formula


def test_a_response_may_keep_dimensions_and_use_those_before_it(wave):
    cube = wave({"half": "force / 2", "quarter": "half[90] / 2"})
    assert cube["half"].dims == ("a", "angle")
    assert cube["quarter"].values[:2].tolist() == [0.25, 0.5]


def test_the_numerical_error_is_carried_through_or_said_to_be_unknown(wave):
    """Exact: the error of a product, and of a response of a response; that of the waveform is not known."""
    cube = wave({"tripled": "3 * size", "square": "tripled**2", "peak": "max(force)"})
    assert cube["tripled_error"].values[:2] == pytest.approx([0.03, 0.06])
    assert cube["square_error"].values[:2] == pytest.approx([3.03**2 - 9, 4 * (3.03**2 - 9)])
    assert "peak_error" not in cube
    assert "numerical error: not known" in cube["peak"].attrs["comment"]


def test_outputs_that_only_formulas_use_are_not_in_the_cube(wave):
    cube = wave({"peak": "max(force)"}, '[keep]\noutputs = ["size"]\n')
    assert {"size", "peak"} <= set(cube.data_vars)
    assert not {"force", "parts", "angle"} & set(cube.variables)


@pytest.mark.slow
def test_a_study_grows_by_responses_without_running_a_point(wave, tmp_path):
    wave({"peak": "max(force)"})
    summary = td.run(tmp_path / "wave.toml", tmp_path / "out", workers=0, progress=False)
    assert (summary.computed, summary.reused) == (0, 3)
    assert wave({"peak": "2 * max(force)", "low": "min(force)"})["peak"].values[:2].tolist() == [2, 4]
    (tmp_path / "more.toml").write_text('[responses.both]\nformula = "peak - low"\nunit = "N"\n')
    summary = td.derive(tmp_path / "out", tmp_path / "more.toml")
    assert (summary.computed, summary.reused) == (0, 3)
    answer = td.query(tmp_path / "out", "both", where="both > 5")
    assert answer["both"].where(answer["selected"]).values == pytest.approx([np.nan, 8, np.nan], nan_ok=True)


@pytest.mark.slow
def test_what_was_derived_is_kept_when_a_study_runs_on(wave, tmp_path, capsys):
    """Invariance: neither a run of the same file nor one of a larger study loses a derived variable."""
    wave({"peak": "max(force)"})
    (tmp_path / "more.toml").write_text('[responses.twice]\nformula = "2 * peak"\nunit = "N"\nmeaning = "both sides"\n')
    td.derive(tmp_path / "out", tmp_path / "more.toml")
    td.run(tmp_path / "wave.toml", tmp_path / "out", workers=0)
    assert "kept: twice, added to these results before" in capsys.readouterr().err
    with td.open_cube(tmp_path / "out") as cube:
        assert cube["twice"].values[:2].tolist() == [2, 4]
        assert cube["twice"].attrs["units"] == "N"
    cube = wave({"peak": "max(force)", "twice": "3 * peak"})  # the study's own formula comes first, and that is said
    assert cube["twice"].values[:2].tolist() == [3, 6]
    td.run(tmp_path / "wave.toml", tmp_path / "out", workers=0)
    assert "replaced: twice, added to these results before, by the study's formula" in capsys.readouterr().err


def test_what_the_results_do_not_hold_is_refused_and_nothing_changes(wave, tmp_path):
    wave({}, '[keep]\noutputs = ["size"]\n')
    before = (tmp_path / "out" / "study.toml").read_bytes()
    (tmp_path / "more.toml").write_text('[responses.peak]\nformula = "max(force)"\n')
    with pytest.raises(InputError, match=r"\[responses.peak\]: force: not among the outputs"):
        td.derive(tmp_path / "out", tmp_path / "more.toml")
    (tmp_path / "more.toml").write_text('[base]\nb = 1\n[responses.peak]\nformula = "size"\n')
    with pytest.raises(InputError, match=r"\[base\]: only"):
        td.derive(tmp_path / "out", tmp_path / "more.toml")
    (tmp_path / "more.toml").write_text("responses = 3")
    with pytest.raises(InputError, match=r"responses = 3: expected tables, as \[responses.NAME\]"):
        td.derive(tmp_path / "out", tmp_path / "more.toml")
    assert (tmp_path / "out" / "study.toml").read_bytes() == before


def test_what_a_function_does_not_return_is_named_and_points_are_kept(wave, tmp_path):
    with pytest.raises(InputError, match=r"\[responses.peak\].*unknown name 'forc'; did you mean 'force'"):
        wave({"peak": "max(forc)"})
    wave({"peak": "max(force)"})
    assert td.run(tmp_path / "wave.toml", tmp_path / "out", workers=0, progress=False).computed == 0


JOINT = "[study]\nname = 'r'\n[factors.torque_n_m]\nvalues = [25, 50]\n"


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ("[responses.r]\nformula = 'thrust_amplitud[3]'", "at character 1: unknown name .* mean 'thrust_amplitude'"),
        ("[responses.r]\nformula = '1 + thrust_amplitude[13]'", "at character 5: thrust_amplitude: no order 13"),
        ("[responses.r]\nformula = 'groove_thrust_amplitude[3]'", "dimensions groove, order; write one label for each"),
        ("[responses.r]\nformula = 'thrust[0:90] - thrust[90:180]'", "values at different rotation_deg"),
        ("[responses.r]\nformula = 'sum(thrust, \"order\")'", "no dimension 'order'"),
        ("[responses.r]\nformula = 'max(largest_penetration_um)'", "max of a single value"),
        ("[responses.r]\nformula = 'thrust.real'", "not allowed"),
        ("[responses.r]\nformula = '2 * 3'", "uses no output and no parameter"),
        (
            "[responses.r]\nformula = 'groove_thrust * groove_thrust_amplitude * friction_power_w'",
            "values for each point",
        ),
        ("[responses.thrust]\nformula = 'thrust'", "taken"),
        ("[responses.order]\nformula = 'thrust'", "taken"),
        ("[responses.torque_n_m]\nformula = 'thrust'", "taken"),
        ("[responses.model_error]\nformula = 'thrust'", "reserved"),
        ("[responses.r_error]\nformula = 'thrust'", "reserved"),
        ("[responses.'../r']\nformula = 'thrust'", "not a name"),
        ("[responses.a-b]\nformula = 'thrust'", "not a name"),
        ("[responses.r]\nformul = 'thrust'", "unknown key 'formul'; did you mean 'formula'"),
        ("[responses.r]\nformula = 's'\n[responses.s]\nformula = 'max(thrust)'", "put it before"),
    ],
)
def test_a_wrong_response_is_refused_before_anything_runs(tables, message):
    with pytest.raises(InputError, match=message) as refused:
        parse_study(JOINT + tables)
    assert "responses" in str(refused.value)


def test_a_formula_that_takes_longer_than_points_do_is_refused():
    spread = "[responses.a]\nformula = 'groove_thrust * thrust_amplitude'\n"  # 28,080 values for a point
    with pytest.raises(InputError, match=r"\[responses.r\]: .* operations; at most .* index or reduce"):
        parse_study(f"{JOINT}{spread}[responses.r]\nformula = 'max({', '.join(['a'] * 800)})'")
    chain = "[responses.a]\nformula = 'thrust_amplitude * 2'\n"
    study = parse_study(f"{JOINT}{chain}[responses.b]\nformula = 'max(a) + max(a)'")
    assert study.responses[1].widest == study.responses[0].size
    many = "".join(f"[responses.r{k}]\nformula = 'max(thrust)'\n" for k in range(201))
    with pytest.raises(InputError, match=r"\[responses\]: 201 formulas; at most 200"):
        parse_study(JOINT + many)


def test_few_points_at_a_time_give_the_same(wave, monkeypatch):
    formulas = {"spread": "parts * force", "rise": "size - 1"}
    together = wave(formulas)
    monkeypatch.setattr("tripod_doe.study.cube.responses._MOST_VALUES", 8)
    apart = wave(formulas, out="apart")
    for name in formulas:
        np.testing.assert_array_equal(apart[name], together[name])


@pytest.mark.slow
def test_responses_of_the_joint_are_shown_and_analysed(tmp_path):
    """Exact: the decibels of the third order; the largest force of a waveform that the cube does not keep."""
    text = """
        [study]
        name = "loud"
        [factors.torque_n_m]
        low = 25
        high = 100
        [design]
        kind = "latin-hypercube"
        samples = 24
        [responses.loudness]
        formula = "20 * log10(thrust_amplitude[3])"
        unit = "dB"
        [responses.peak]
        formula = "max(abs(thrust))"
        unit = "N"
        [keep]
        outputs = ["thrust_amplitude"]
        [analysis.tolerance]
        limits = { peak = 20 }
        [analysis.pawn]
        outputs = ["peak"]
    """
    (tmp_path / "loud.toml").write_text(textwrap.dedent(text))
    summary = td.run(tmp_path / "loud.toml", tmp_path / "out", workers=0, progress=False)
    cube = td.open_cube(tmp_path / "out")
    third = cube["thrust_amplitude"].sel(order=3).values
    assert cube["loudness"].values == pytest.approx(20 * np.log10(third))
    alone = td.simulate(torque_n_m=float(cube["torque_n_m"][0]))
    assert float(cube["peak"][0]) == pytest.approx(float(np.abs(alone["thrust"]).max()), rel=1e-9)
    assert "thrust" not in cube
    said = " ".join([*summary.answers, *summary.findings])
    assert "The probability that peak exceeds 20 N" in said
    assert "PAWN indices of peak" in said
    assert "peak is proportional to torque" in said
