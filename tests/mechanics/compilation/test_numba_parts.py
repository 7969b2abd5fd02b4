"""Private parts of numba: all that are used are known, and a version without them is refused in a sentence."""

from __future__ import annotations

import ast
import re
import tomllib
from pathlib import Path

import numba.core.caching
import numba.core.event
import pytest

from tripod_doe.errors import InputError
from tripod_doe.mechanics.compilation import numba_parts
from tripod_doe.mechanics.compilation.numba_parts import PARTS, TRIED, check_numba

ROOT = Path(__file__).parents[3]


def imported():
    """Names that the package imports from numba and llvmlite, by module."""
    found = {}
    for path in (ROOT / "src").rglob("*.py"):
        text = path.read_text()
        for node in ast.walk(ast.parse(text)) if re.search("from (numba|llvmlite)", text) else ():
            if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in ("numba", "llvmlite"):
                found.setdefault(node.module, set()).update(name.name for name in node.names)
    return found


def test_the_bound_is_that_of_the_package():
    dependencies = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    assert f"numba{TRIED}" in dependencies


def test_all_parts_that_are_imported_are_looked_for():
    for module, names in imported().items():
        known = set(PARTS.get(module, ())) | {owner.rpartition(".")[2] for owner in PARTS if owner.startswith(module)}
        assert names <= known, module


@pytest.mark.parametrize("installed", ["0.60.0", "0.69.0rc1", "1.0"])
def test_another_version_is_used_if_it_has_all_parts(monkeypatch, installed):
    monkeypatch.setattr(numba_parts, "version", lambda _: installed)
    check_numba()


def test_a_version_that_lacks_parts_is_refused_in_a_sentence(monkeypatch):
    monkeypatch.delattr(numba.core.caching.CacheImpl, "_locator_classes")
    monkeypatch.delattr(numba.core.event, "install_listener")
    check_numba()  # that of the bound is not looked at
    monkeypatch.setattr(numba_parts, "version", lambda _: "0.70.2")
    with pytest.raises(InputError) as refused:
        check_numba()
    assert str(refused.value) == (
        "numba 0.70.2 lacks numba.core.caching.CacheImpl._locator_classes, numba.core.event.install_listener, which "
        "the kernels of this tripod-doe use; install a version that was tried: python3 -m pip install 'numba>=0.61,<0.69'"
    )


def test_a_module_that_is_gone_counts_as_missing():
    assert not numba_parts._has("numba.core.gone", "anything")
    assert not numba_parts._has("numba.core.caching.Gone", "anything")
