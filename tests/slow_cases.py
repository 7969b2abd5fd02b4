"""Cases of a test of which only the first belong to the fast tests."""

from __future__ import annotations

from collections.abc import Iterable

import pytest


def first_fast(cases: Iterable[object], fast: int) -> list[object]:
    """All cases of a parameter; those behind the first `fast` ones are marked as slow."""
    return [each if n < fast else _slow(each) for n, each in enumerate(cases)]


def _slow(case):
    return pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.slow)
