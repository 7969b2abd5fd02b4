"""Open cubes that workers keep: none is shown in the place of other results."""

from __future__ import annotations

import os
import shutil

import pytest

import tripod_doe as td
from tripod_doe.service.explorer.open_cubes import opened
from tripod_doe.study.journal import STUDY, Journal, text_digest

pytestmark = pytest.mark.usefixtures("pages_not_made")


def made(path, torque, angles=(4, 8)):
    study = {
        "study": {"name": "kept"},
        "base": {"model": "equilibrium", "torque_n_m": torque},
        "factors": {"joint_angle_deg": {"values": list(angles)}},
        "keep": {"outputs": ["thrust_rms"]},
    }
    td.run(study, out=path, workers=0)
    return path


def shown(place):
    """What a worker shows of a directory."""
    with opened(place) as cube:
        return float(cube["thrust_rms"].sel(order=3).max())


@pytest.mark.parametrize("interrupted", [False, True])
def test_results_in_the_place_of_others_are_shown(tmp_path, interrupted):
    """Regression: results as large as the former ones, and as old or interrupted after as many blocks, were not."""
    place, other = made(tmp_path / "place", 50), made(tmp_path / "other", 60)
    times = (place / "cube.nc").stat()
    for directory in (place, other):
        for file in directory.iterdir():
            os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))
        if interrupted:
            (directory / "cube.nc").unlink()
    first = shown(place)
    shutil.rmtree(place)
    other.rename(place)
    assert shown(place) == pytest.approx(1.2 * first, rel=0.02)


def test_an_interrupted_study_that_has_grown_is_shown(tmp_path):
    """Regression: until its next block, the explorer showed the smaller one."""
    place, grown = made(tmp_path / "place", 50), made(tmp_path / "grown", 50, (4, 8, 12))
    (place / "cube.nc").unlink()
    with opened(place) as cube:
        assert cube.sizes["joint_angle_deg"] == 2
    shutil.copy(grown / "study.toml", place / "study.toml")
    with Journal(place) as journal:
        journal.remember({STUDY: text_digest((place / "study.toml").read_bytes())})
    with td.open_cube(place) as now, opened(place) as cube:
        assert now.sizes["joint_angle_deg"] == 3 == cube.sizes["joint_angle_deg"]
