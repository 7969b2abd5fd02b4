"""Flip single bits of the files of a result directory, and judge what readers and the next run make of it.

    python benchmarks/flips.py [--flips 1000] [--runs 40] [--seed 0]

Each flip of cube.nc, cost.nc, analysis/sobol.nc and journal.sqlite, the latter with its cube and as an interrupted run
leaves it, is read by `query`, `td.open_cube` and `check`. It must be refused with a message that names the file, or the
answer must equal that of the undamaged files. After some flips the study is run again, and everything must be as it was.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import random
import shutil
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import xarray as xr

import tripod_doe as td
from tripod_doe.cli import main as tripod_doe

STUDY = """
[study]
name = "flips"
question = "Which numbers survive?"
[base]
model = "equilibrium"
[factors]
joint_angle_deg = {low = 4, high = 12}
torque_n_m = {low = 50, high = 150}
groove_sliding_friction = {low = 0.04, high = 0.08}
[design]
kind = "saltelli"
samples = 16
seed = 1
[keep]
outputs = ["thrust", "thrust_amplitude"]
[run]
block = 16
[analysis.sobol]
"""
FILES = ("cube.nc", "cost.nc", "analysis/sobol.nc", "journal.sqlite", "interrupted/journal.sqlite")
ASKED = {
    "analysis/sobol.nc": ("analysis/sobol.nc", "ST"),
    "cost.nc": (".", "steps"),
    "interrupted/journal.sqlite": ("interrupted", "thrust_amplitude"),
}


def call(*words: str) -> tuple[int, str, str]:
    """Run the command line in this process: exit code, standard output, standard error."""
    answer, messages = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(answer), contextlib.redirect_stderr(messages):
        code = tripod_doe(list(words))
    return code, answer.getvalue(), messages.getvalue()


def make(folder: Path) -> Path:
    """Run the study, and copy what a run leaves that was killed before it wrote its cube."""
    (folder / "study.toml").write_text(STUDY)
    out = folder / "out"
    td.run(folder / "study.toml", out, workers=0, progress=False)
    shutil.copytree(out, out / "interrupted", ignore=shutil.ignore_patterns("*.nc", "report", "analysis"))
    return out


def answers(out: Path, file: str) -> list[object]:
    """Give what readers answer that a file is behind."""
    place, variable = ASKED.get(file, (".", "thrust_amplitude"))
    code, answer, message = call("query", str(out / place), "--variable", variable, "--format", "csv")
    if code:
        raise td.CubeError(message)
    return [answer, td.open_cube(out / place)]


def same(one: list[object], other: list[object]) -> bool:
    """Whether two answers are equal, attributes too."""
    return all(a.identical(b) if isinstance(a, xr.Dataset) else a == b for a, b in zip(one, other, strict=True))


@contextlib.contextmanager
def flipped(path: Path, bit: int) -> Iterator[None]:
    """A file with one bit flipped, as long as this lasts."""
    content = path.read_bytes()
    changed = bytearray(content)
    changed[bit // 8] ^= 1 << bit % 8
    path.write_bytes(changed)
    try:
        yield
    finally:
        path.write_bytes(content)


def judge(out: Path, file: str, expected: list[object]) -> str:
    """Read a damaged file; AssertionError where an answer is wrong or a message does not name the file."""
    try:
        read, message = answers(out, file), ""
    except td.CubeError as error:
        read, message = [], str(error)
    verdict = "refused" if message else "harmless"
    assert Path(file).name in message if message else same(read, expected), f"{file}: {message or 'another answer'}"
    code, report, _ = call("check", str(out / file))
    assert code in (0, 3), report
    return f"{verdict}, {'whole' if code == 0 else 'damaged'} by check"


def run_again(folder: Path, file: str, expected: list[object]) -> None:
    """Run the study in the directory of a damaged file; its answers must be those of before."""
    out = folder / "out" / ("interrupted" if file.startswith("interrupted") else ".")
    code, _, messages = call("run", str(folder / "study.toml"), "--out", str(out), "--workers", "0")
    assert code == 0, messages
    cube = td.open_cube(out)
    old = expected[1]
    assert isinstance(old, xr.Dataset)
    if not file.startswith("analysis"):
        steady = [name for name in old.data_vars if name not in ("cpu_seconds", "wall_seconds", "worker")]
        assert cube[steady].equals(old[steady])
    code, report, _ = call("check", str(out))
    assert code == 0, report


def main(arguments: list[str] | None = None) -> None:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--flips", type=int, default=1000)
    words.add_argument("--runs", type=int, default=40)
    words.add_argument("--seed", type=int, default=0)
    options = words.parse_args(arguments)
    rng, verdicts = random.Random(options.seed), Counter()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        out = make(folder)
        expected = {file: answers(out, file) for file in FILES}
        for number in range(options.flips):
            file = FILES[number % len(FILES)]
            bit = rng.randrange(8 * (out / file).stat().st_size)
            with flipped(out / file, bit):
                verdicts[file, judge(out, file, expected[file])] += 1
        for number in range(options.runs):
            file = FILES[number % len(FILES)]
            whole = folder / "whole"
            shutil.copytree(out, whole)
            content = bytearray((out / file).read_bytes())
            bit = rng.randrange(8 * len(content))
            content[bit // 8] ^= 1 << bit % 8
            (out / file).write_bytes(content)
            run_again(folder, file, expected[file])
            verdicts[file, "run again: as before"] += 1
            shutil.rmtree(out)
            whole.rename(out)
    for (file, verdict), count in sorted(verdicts.items()):
        print(f"{count:6}  {file}: {verdict}")


if __name__ == "__main__":
    main()
