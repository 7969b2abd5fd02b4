"""Fingerprints: what they are made of, and how points are found by them."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.designs import make_points
from tripod_doe.study.fingerprints import KeyIndex, point_keys

STUDIES = {
    "a grid with words": (
        '[factors.model]\nvalues=["rollers", "equilibrium"]\n[factors.torque_n_m]\nlow=-50\nhigh=50\ncount=5\n'
    ),
    "a first and a last parameter": (
        "[factors.accuracy]\nvalues=[0.01, 0.02]\n[factors.youngs_modulus_gpa]\nvalues=[200, 210]\n"
    ),
    "samples": '[factors.speed_rpm]\nlow=100\nhigh=2000\n[design]\nkind="halton"\nsamples=30\n',
}


def as_defined(study, points):
    """Every fingerprint by itself: BLAKE2b of the names of all parameters and of their values."""
    full = study.simulator.columns(study.base, points.at(slice(None)), points.count)
    named = "\n".join([study.simulator.name, *sorted(full), *([study.accuracy.text] if study.accuracy else [])])

    def number(value):
        if isinstance(value, float | int | np.number):
            return np.float64(value + 0.0).tobytes()
        return hashlib.blake2b(str(value).encode(), digest_size=8).digest()

    return [
        hashlib.blake2b(
            named.encode() + b"".join(number(full[name][row]) for name in sorted(full)), digest_size=16
        ).digest()
        for row in range(points.count)
    ]


@pytest.mark.parametrize("text", STUDIES.values(), ids=STUDIES)
def test_a_fingerprint_is_that_of_all_parameters_whichever_of_them_are_factors(text):
    """Results of earlier versions are found by it, so it must never change."""
    study = parse_study(f'[study]\nname = "k"\n{text}')
    points = make_points(study)
    assert [key.tobytes() for key in point_keys(study, points)] == as_defined(study, points)


SEEDED = """
[study]
name = "seeds"
[factors]
torque_n_m = {low = 10, high = 100}
needle_count = {low = 20, high = 29}
model = {distribution = "discrete", values = ["rollers", "equilibrium"], weights = [1, 3]}
[design]
"""
RECORDED = {
    'kind = "sobol"\nseed = 5\nsamples = 10_000': "dd55256e52fd83ef",
    'kind = "halton"\nseed = 5\nsamples = 10_000': "535d2f5d79ef8159",
    'kind = "saltelli"\nseed = 5\nsamples = 1024': "b87afb5e4ef7f4a5",
    'kind = "saltelli"\nseed = 5\nsamples = 1024\nsecond_order = false': "29f6318e4a226bc6",
    'kind = "latin-hypercube"\nseed = 5\nsamples = 1000': "5611f09ca530b9f1",
    'kind = "morris"\nseed = 5\nsamples = 50': "c1b85846b279849b",
    'kind = "rbd-fast"\nseed = 5\nsamples = 500': "505a436b3d71f102",
    'kind = "product"\nof = ["torque", "rest"]\n'
    '[design.torque]\nkind = "sobol"\nsamples = 30\nfactors = ["torque_n_m"]\n'
    '[design.rest]\nkind = "halton"\nsamples = 20\nfactors = ["model", "needle_count"]': "7baccea51573159c",
}


def columns_digest(points):
    """Values of all factors; fingerprints would change with every new parameter of the joint."""
    columns = [column.astype(str) if column.dtype.kind in "OU" else column for column in points.columns.values()]
    return hashlib.sha256(b"".join(np.ascontiguousarray(column).tobytes() for column in columns)).hexdigest()[:16]


@pytest.mark.parametrize(("design", "recorded"), RECORDED.items())
def test_a_seed_gives_the_points_that_it_always_gave(design, recorded):
    """Regression: a design that is made again has the points whose results are stored (recorded at 100d85e)."""
    assert columns_digest(make_points(parse_study(SEEDED + design))) == recorded


@pytest.mark.parametrize(
    ("design", "recorded"),
    [
        ('kind = "finite-differences"\nsamples = 50', "4d7d5f2b383c9d69"),
        ('kind = "fast"\nseed = 5\nsamples = 100', "8939b0a490a12dbe"),
    ],
)
def test_designs_without_levels_give_the_points_that_they_always_gave(design, recorded):
    """Recorded at bf0b7ea; they take no factor with levels."""
    factors = "torque_n_m = {low = 10, high = 100}\nspeed_rpm = {low = 100, high = 900}\n"
    points = make_points(parse_study(f'[study]\nname = "seeds"\n[factors]\n{factors}[design]\n{design}\n'))
    assert columns_digest(points) == recorded


def keys_of(*numbers):
    """Fingerprints, each of two 64-bit words."""
    return np.array(numbers, np.uint64).view("V16").ravel()


def test_points_are_found_also_where_half_a_fingerprint_is_shared_by_chance():
    keys = keys_of((1, 5), (1, 4), (2, 1), (1, 5), (1, 4), (3, 3))
    index = KeyIndex(keys)
    assert index.first_of_each().tolist() == [True, True, True, False, False, True]
    rows, places = index.places(keys_of((1, 4), (9, 9), (1, 7), (2, 1)))
    assert sorted(zip(rows.tolist(), places.tolist(), strict=True)) == [(0, 1), (0, 4), (3, 2)]


def test_many_points_are_found_as_by_a_dictionary():
    rng = np.random.default_rng(1)
    keys = keys_of(*rng.integers(0, 2**64, (400, 2), np.uint64))[rng.integers(0, 400, 1000)]
    expected = {}
    for place, key in enumerate(keys):
        expected.setdefault(key.tobytes(), place)
    index = KeyIndex(keys)
    assert np.flatnonzero(index.first_of_each()).tolist() == sorted(expected.values())
    rows, places = index.places(keys)
    assert (keys[rows] == keys[places]).all()
    counts = np.unique(keys, return_counts=True)[1]
    assert rows.size == (counts**2).sum()


def test_no_points_are_found_among_none():
    index = KeyIndex(np.array([], "V16"))
    assert index.first_of_each().size == 0
    assert index.places(keys_of((1, 2)))[0].size == 0
