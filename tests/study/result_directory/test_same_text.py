"""Directories whose studies have the same text: which results are theirs follows from more than its hash."""

import shutil

import pytest

import tripod_doe as td
from tripod_doe.errors import CubeError
from tripod_doe.study.cube import writing
from tripod_doe.study.result_directory.open_cube import opened_cube

pytestmark = pytest.mark.usefixtures("pages_not_made")

TEXT = """
[study]
name = "table"
function = "twice:f"

[design]
kind = "table"
table = "points.csv"
"""


@pytest.fixture
def run(tmp_path):
    """Runs the study with some values of x in its table, into a directory."""
    (tmp_path / "twice.py").write_text("def f(x=0.0):\n    return {'y': 2 * x}\n")
    (tmp_path / "study.toml").write_text(TEXT)

    def run_with(values, name):
        (tmp_path / "points.csv").write_text("\n".join(["x", *map(str, values)]))
        td.run(tmp_path / "study.toml", out=tmp_path / name, workers=0, progress=False)
        return tmp_path / name

    return run_with


def by_arrays(directory):
    with opened_cube(directory) as cube:
        return dict(zip(cube["x"].values.tolist(), cube.variables["y"].values.tolist(), strict=True))


def by_xarray(directory):
    with opened_cube(directory) as cube:
        return dict(zip(cube["x"].values.tolist(), cube["y"].values.tolist(), strict=True))


def test_a_kill_between_costs_and_cube_of_a_reordered_table_swaps_no_labels(run, monkeypatch):
    """Regression: the new labels of the costs stood beside the old values of the cube, and check called them whole."""
    directory, write = run([4, 8], "results"), writing.write_dataset

    def killed(dataset, path):
        if path.name == "cube.nc":
            raise KeyboardInterrupt
        write(dataset, path)

    with monkeypatch.context() as patch:
        patch.setattr(writing, "write_dataset", killed)
        with pytest.raises(KeyboardInterrupt):
            run([8, 4], "results")
    assert by_arrays(directory) == by_xarray(directory) == {8: 16, 4: 8}
    run([8, 4], "results")
    assert list(by_arrays(directory)) == list(by_xarray(directory)) == [8, 4]


@pytest.mark.parametrize("copied", [["cube.nc"], ["cube.nc", "cost.nc"]])
def test_a_cube_of_another_directory_is_refused_although_its_study_has_the_same_text(run, copied):
    """Regression: its values were served with the labels of this directory, and check called it whole."""
    one, other = run([4, 8], "one"), run([10, 14], "other")
    for name in copied:
        shutil.copy(one / name, other / name)
    for read in (by_arrays, by_xarray):
        with pytest.raises(CubeError, match="its results are of another directory"):
            read(other)
    run([10, 14], "other")
    assert by_arrays(other) == {10: 20, 14: 28}


def test_a_copied_directory_has_its_results(run):
    directory = run([4, 8], "results")
    copy = shutil.copytree(directory, directory.with_name("copy"))
    assert by_arrays(copy) == {4: 8, 8: 16}
