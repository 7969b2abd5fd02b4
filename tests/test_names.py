"""Names from files and addresses: identifiers, and paths that stay below their folder."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tripod_doe.errors import InputError
from tripod_doe.names import check_identifier, path_within

HOSTILE = [
    "",
    ".",
    "..",
    "../x",
    "/x",
    "a/b",
    "a\\b",
    "x\x00",
    "x\n",
    "\x1b[2J",
    "-rf",
    ".hidden",
    "CON",
    "nul",
    "a" * 300,
]


@pytest.mark.parametrize("name", [*HOSTILE, "a b", "a.b", "ä", "a:b", "lpt1", "x" * 101])
def test_what_is_no_identifier_is_refused_in_printable_words(name):
    with pytest.raises(InputError, match="not a name for a step") as refused:
        check_identifier(name, "a step")
    assert str(refused.value).isprintable()


@pytest.mark.parametrize("name", ["a", "_a", "0", "sobol-2", "A_1", "x" * 100, "console"])
def test_identifiers_pass(name):
    assert check_identifier(name, "a step") == name


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])  # a loaded machine is no fault
@given(st.one_of(st.sampled_from(HOSTILE), st.text(max_size=20)), st.text(max_size=5))
def test_a_path_stays_below_its_folder_or_is_refused(name, ending):
    folder = Path("/some/folder")
    with suppress(InputError):
        path = path_within(folder, "analysis", name + ending)
        assert path.parent == path.resolve().parent == folder / "analysis"
