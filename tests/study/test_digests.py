"""Compiled fingerprints: those of `hashlib`, whatever the lengths."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

from tripod_doe.study.definition import parse_study
from tripod_doe.study.designs import fingerprints, make_points, point_keys
from tripod_doe.study.designs.digests import digests_of


@pytest.mark.parametrize("length", [0, 1, 127, 128, 129, 300, 384])
@pytest.mark.parametrize("numbers", [1, 15, 16, 17, 40])
def test_digests_are_those_of_hashlib(length, numbers):
    """Exact: none, one and several blocks, whole and not, and numbers that begin anywhere in a word."""
    random = np.random.default_rng(length)
    beginning, ends = random.bytes(length), random.normal(size=(35, numbers))
    expected = [hashlib.blake2b(beginning + end.tobytes(), digest_size=16).digest() for end in ends]
    assert [digest.tobytes() for digest in digests_of(beginning, ends)] == expected


@pytest.mark.parametrize(
    "factor", ["torque_n_m = {values = [25, 50, 100]}", 'model = {values = ["rollers", "needles"]}']
)
def test_points_have_the_same_fingerprints_however_many_they_are(monkeypatch, factor):
    """Exact: also of the last chunk, which is not full."""
    text = f'[study]\nname = "d"\n[factors]\njoint_angle_deg = {{low = 2, high = 14, count = 7}}\n{factor}'
    study = parse_study(text)
    points = make_points(study)
    keys = point_keys(study, points)
    monkeypatch.setattr(fingerprints, "_MANY", 0)
    monkeypatch.setattr(fingerprints, "_CHUNK", 5)
    assert (point_keys(study, points) == keys).all()
    assert len(set(keys.tolist())) == points.count
