"""Settings of analyses: checked before anything runs, as strictly as any other table of a file."""

import pytest

from tripod_doe.analyses.registry import ANALYSES
from tripod_doe.errors import InputError
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.workflow.analyses import check_analyses, checked_settings

NEEDED = {
    "stability": {"output": "y"},
    "comparison": {"measurement": "rig.csv"},
    "choose": {"study": "s.toml"},
    "claims-over-skew": {"skews_deg": [0.1, 0.2]},
}


def numbers():
    for kind, row in ANALYSES.items():
        for key, entry in row.settings.model_json_schema()["properties"].items():
            types = {part.get("type") for part in (entry, *entry.get("anyOf", ())) if "enum" not in part}
            if {"number", "integer"} & types:
                yield kind, key


@pytest.mark.parametrize(("kind", "key"), list(numbers()))
def test_a_number_is_a_number(kind, key):
    """Regression: true counted as 1, and "20" as 20."""
    for value in (True, "20", float("nan"), float("inf")):
        with pytest.raises(InputError, match=rf"{key} = .*(expected a (whole )?number|must be finite)"):
            checked_settings(ANALYSES[kind].settings, {**NEEDED.get(kind, {}), key: value})


@pytest.mark.parametrize(
    ("kind", "table", "message"),
    [
        ("effects", {"squares": 1}, "squares = 1: expected true or false"),
        ("effects", {"squares": "no"}, "squares = 'no': expected true or false"),
        ("sobol", {"outputs": [3]}, r"outputs\.0 = 3: expected text in quotes"),
        ("tolerance", {"limits": {"thrust_amplitude_3": True}}, "limits.thrust_amplitude_3 = true: expected a number"),
        ("tolerance", {"limits": 3}, "limits = 3: expected a table"),
        ("tolerance", {"probabilities": ["0.5"]}, r"probabilities\.0 = '0.5': expected a number"),
        ("comparison", {"speeds_rpm": [True, 600]}, r"speeds_rpm\.0 = true: expected a number"),
        ("comparison", {"speeds_rpm": 600}, r"speeds_rpm = 600: expected a list, as speeds_rpm = \[600\]"),
        ("claims-over-skew", {"skews_deg": [-0.2, 0.2]}, r"skews_deg\.0 = -0.2: must be above 0"),
        ("morris", {"precision": -1}, "precision = -1: must be above 0"),
        ("dgsm", {"precision": 0}, "precision = 0: must be above 0"),
    ],
)
def test_a_wrong_setting_is_named(kind, table, message):
    with pytest.raises(InputError, match=message):
        checked_settings(ANALYSES[kind].settings, {**NEEDED.get(kind, {}), **table})


def test_a_range_of_speeds_is_a_list_of_two_numbers():
    settings = checked_settings(ANALYSES["comparison"].settings, {**NEEDED["comparison"], "speeds_rpm": [550, 600.0]})
    assert settings.speeds_rpm == (550.0, 600.0)


@pytest.mark.parametrize("setting", ["keep = 0.9", "confirm = 100", "costs = {speed_rpm = 2}"])
def test_settings_for_limits_need_limits(setting):
    """Regression: they were accepted, and did nothing."""
    text = (
        '[study]\nname = "t"\n[factors]\nspeed_rpm = {low = 500, high = 700}\n[design]\nkind = "sobol"\nsamples = 8\n'
    )
    check_analyses(parse_study(f"{text}[analysis.tolerance]\nlimits = {{thrust_amplitude_3 = 20}}\n{setting}\n"))
    with pytest.raises(InputError, match=f"{setting[:4]}.*: used with limits only"):
        check_analyses(parse_study(f"{text}[analysis.tolerance]\n{setting}\n"))


def test_a_scene_beside_a_function_is_refused():
    """Regression: it was accepted, and did nothing."""
    with pytest.raises(InputError, match="scene and function: give one"):
        parse_study(
            '[study]\nname = "s"\nscene = "joint"\nfunction = "textwrap:dedent"\n[factors.text]\nvalues = ["a"]\n'
        )
