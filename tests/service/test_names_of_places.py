"""What the service says names files as its clients know them, not where they are on the server."""

from pathlib import Path
from tempfile import gettempdir

from tripod_doe.service.problems import Problem, RefusedError, among_runs


def test_paths_begin_in_the_folder_of_runs(tmp_path):
    """Regression: refusals named the whole path to the holder of a link."""
    told = f"{tmp_path}/abc/cube.nc: damaged; run it again with {tmp_path}/abc and not {tmp_path}2/x"
    assert among_runs(told, tmp_path) == f"abc/cube.nc: damaged; run it again with abc and not {tmp_path}2/x"
    refusal = RefusedError(422, Problem(message=told, file=f"{tmp_path}/abc/cube.nc", line=3)).among_runs(tmp_path)
    assert (refusal.problems[0].file, refusal.problems[0].line) == ("abc/cube.nc", 3)
    assert refusal.status == 422
    assert among_runs(f"{gettempdir()}/tripod-doe-x1/cube.nc: no space", Path("runs")) == "cube.nc: no space"
