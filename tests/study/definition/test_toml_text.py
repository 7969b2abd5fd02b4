"""TOML texts that a program writes."""

import tomllib

import pytest
import tomlkit

from tripod_doe.study.definition.toml_text import toml_array, toml_text


@pytest.mark.parametrize("values", [[], [1], [1, 2.5, -0.0, 1e-300, True], ["", 'a "b"\n\x7f \\ é']])
def test_an_array_reads_as_it_was_given_and_looks_as_any_other(values):
    assert tomllib.loads(toml_text({"a": {"b": values}})) == {"a": {"b": values}}
    assert toml_array(values).as_string() == tomlkit.item(values).as_string()


def test_lists_of_tables_and_of_lists_stay_as_they_are():
    tables = {"run": {"retry": [{"model": "rollers"}, {"cycles": 8}]}, "x": {"y": [[1, 2], [3]]}}
    assert tomllib.loads(toml_text(tables)) == tables


def test_twenty_thousand_numbers_take_no_time_of_note():
    """Regression: 6 min, since each number that is appended to an array of tomlkit counts all before."""
    values = [number / 3 for number in range(20_000)]
    assert tomllib.loads(toml_text({"factors": {"x": {"values": values}}}))["factors"]["x"]["values"] == values
