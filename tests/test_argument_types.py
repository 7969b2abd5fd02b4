"""Public functions say in a sentence which argument has a wrong type; no call ends in our own code."""

from __future__ import annotations

import inspect

import pytest
import xarray as xr

import tripod_doe as td
from tripod_doe.errors import InputError

pytestmark = pytest.mark.usefixtures("pages_not_made")

FUNCTIONS = [name for name in td.__all__ if inspect.isfunction(getattr(td, name)) and name != "workflow_schema"]
WRONG = (object(), -3.5, None, b"bytes", ["a", 1], {"a": object()}, xr.Dataset({"a": ("x", [1.0])}), "no such thing")


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("value", WRONG, ids=lambda value: type(value).__name__)
def test_any_value_as_every_needed_argument_ends_as_a_sentence(name, value, tmp_path, monkeypatch):
    """The error is ours; a simulation needs no argument at all."""
    monkeypatch.chdir(tmp_path)
    called = getattr(td, name)
    parameters = inspect.signature(called).parameters.values()
    needed = [each.name for each in parameters if each.default is each.empty and each.kind is not each.VAR_KEYWORD]
    if name == "view":  # its one named argument may be missing
        needed = ["joint_angle_deg"]
    words = dict.fromkeys(needed or [each.name for each in parameters if each.kind is not each.VAR_KEYWORD], value)
    with pytest.raises(InputError) as refused:
        called(**(words or {"joint_angle_deg": value}))
    assert str(refused.value)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: td.find("results"),
            "find: cube = 'results': expected an xarray Dataset, as open_cube gives it, not a",
        ),
        (lambda: td.query("cube.nc", "thrust", select="order=3"), "select = 'order=3': expected a dict or a list"),
        (lambda: td.run("study.toml", workers="2"), "run: workers = '2': expected a whole number"),
        (lambda: td.run("study.toml", progress=1), "run: progress = 1: expected True or False"),
        (lambda: td.find(xr.Dataset()), "find: cube: this Dataset is no result cube"),
        (lambda: td.sobol_indices(td.simulate(joint_angle_deg=[4, 8])), "this cube has no study"),
        (lambda: td.connect("results"), "expected an address such as http://"),
    ],
)
def test_the_sentence_names_function_argument_value_and_what_is_expected(call, message):
    with pytest.raises(InputError) as refused:
        call()
    assert message in str(refused.value)


def test_names_keep_their_signatures_and_there_is_a_version():
    assert list(inspect.signature(td.plan).parameters) == ["study", "timing", "recorded", "among"]
    assert td.run is td.run
    assert td.__version__ == "0.1.0"
