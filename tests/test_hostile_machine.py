"""Commands on a machine that refuses something: a full disk, little memory, another locale, a bad disk."""

from __future__ import annotations

import json
import os
import random
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from slow_cases import first_fast
from tripod_doe.cli.main import main

STUDY = '[study]\nname = "größe"\nfunction = "squares:f"\n[factors.x]\nvalues = [1, 2, 3]\n'


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A folder with a study, and its results in `out`."""
    folder = tmp_path_factory.mktemp("bench")
    (folder / "squares.py").write_text("def f(x):\n    return {'y': x * x}\n")
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    assert main(["run", str(folder / "study.toml"), "--out", str(folder / "out"), "--workers", "0"]) == 0
    return folder


def called(words, folder, environment=None, output=subprocess.PIPE, most_bytes=None):
    def limit():
        if most_bytes:
            resource.setrlimit(resource.RLIMIT_AS, (most_bytes, most_bytes))

    return subprocess.run(
        [sys.executable, "-m", "tripod_doe", *words],
        cwd=folder,
        env=os.environ | (environment or {}),
        stdout=output,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        timeout=120,
        preexec_fn=limit,
    )


@pytest.mark.parametrize("buffered", first_fast(["", "1"], 1))
@pytest.mark.parametrize("words", [["query", "out", "--variable", "y"], ["query", "--help"], ["--version"]])
def test_an_answer_that_cannot_be_written_is_told(bench, words, buffered):
    """Regression: it was an internal error, or nothing at all."""
    with open("/dev/full", "w") as full:
        done = called(words, bench, {"PYTHONUNBUFFERED": buffered}, full)
    assert done.returncode == 1
    assert done.stderr == "tripod-doe: cannot write: No space left on device\n"


@pytest.mark.parametrize("ending", ["nc", "csv"])
def test_a_device_is_not_replaced_by_a_file(bench, tmp_path, capsys, ending):
    """Regression: `--output /dev/full` of an administrator made a file of it, and a pipe without a reader blocked."""
    os.mkfifo(pipe := tmp_path / f"pipe.{ending}")
    assert main(["query", str(bench / "out"), "--variable", "y", "--output", str(pipe)]) == 1
    assert "cannot write this file: something other than a file has this name" in capsys.readouterr().err
    assert pipe.is_fifo()


@pytest.mark.parametrize("name", ["cube.nc", "journal.sqlite"])
def test_an_answer_does_not_replace_the_results_that_it_is_from(bench, capsys, name):
    """Regression: the cube was one variable then, and the journal of all finished points a table."""
    before = (bench / "out" / name).read_bytes()
    words = ["query", str(bench / "out"), "--variable", "y", "--format", "csv" if name != "cube.nc" else "netcdf"]
    assert main([*words, "--output", str(bench / "out" / name)]) == 2
    assert "this file holds the results that are read; choose another name" in capsys.readouterr().err
    assert (bench / "out" / name).read_bytes() == before


@pytest.mark.slow
@pytest.mark.parametrize("megabytes", [150, 250])
def test_too_little_memory_is_told(bench, tmp_path, megabytes):
    done = called(["simulate", "--model", "equilibrium"], bench, most_bytes=megabytes << 20)
    assert done.returncode == 1
    assert done.stderr == "tripod-doe: there is not enough memory, or ulimit -v is too low; finished points are kept\n"


PLAIN = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


@pytest.mark.slow
@pytest.mark.parametrize("environment", [{"LC_ALL": "C"}, PLAIN, {"PYTHONIOENCODING": "ascii"}])
def test_commands_do_not_depend_on_the_locale(bench, tmp_path, environment):
    for words in (
        ["run", "study.toml", "--out", str(tmp_path / "out"), "--workers", "0"],
        ["plan", "study.toml", "--no-timing"],
        ["query", str(tmp_path / "out"), "--variable", "y"],
        ["run", "--help"],
    ):
        done = called(words, bench, environment)
        assert done.returncode == 0, done.stderr


def test_a_folder_whose_name_this_locale_cannot_read_is_refused(bench):
    done = called(["run", "study.toml", "--out", "ö", "--workers", "0"], bench, PLAIN)
    assert done.returncode == 2
    assert "not a name in UTF-8, as which this locale reads it; set PYTHONUTF8=1" in done.stderr


@pytest.fixture
def stored(bench):
    path = bench / "out" / "study.toml"
    text = path.read_bytes()
    yield path
    path.write_bytes(text)


@pytest.mark.slow
def test_a_damaged_study_beside_its_results_is_told_or_harmless(bench, stored, capsys):
    """Each bit may have flipped: what can no longer be read is named with its remedy, a changed value is refused."""
    text, chosen, again = stored.read_bytes(), random.Random(3), ["run", str(bench / "study.toml")]
    damaged = [b"", b"\xff\xfe\0", text[:20]]
    for _ in range(25):
        bit, flipped = chosen.randrange(8 * len(text)), bytearray(text)
        flipped[bit // 8] ^= 1 << bit % 8
        damaged.append(bytes(flipped))
    for content in damaged:
        stored.write_bytes(content)
        code, told = main([*again, "--out", str(stored.parent), "--workers", "0"]), capsys.readouterr().err
        assert code in (0, 2), content
        assert "Traceback" not in told
        if code == 2:
            assert "put the file that was run in its place" in told or "the study differs from the study of" in told, (
                content
            )


@pytest.mark.slow
@pytest.mark.parametrize("record", ["[1, 2]", "{}", '{"hash": 1}', "\0", None])
def test_a_step_whose_record_is_damaged_runs_again(bench, tmp_path, record, capsys):
    (bench / "w.toml").write_text('[workflow]\nname = "w"\n[steps.s]\nkind = "study"\nstudy = "study.toml"\n')
    words = ["workflow", str(bench / "w.toml"), "--out", str(tmp_path), "--workers", "0"]
    assert main(words) == 0
    stored = tmp_path / "steps" / "s" / "step.json"
    if record is None:
        stored.write_text(json.dumps(json.loads(stored.read_text()) | {"seconds": "long"}))
    else:
        stored.write_text(record)
    assert main(words) == 0
    assert json.loads(stored.read_text())["hash"] != 1


COMMAND = str(Path(sys.executable).with_name("tripod-doe"))


@pytest.mark.slow
def test_settings_of_libraries_in_the_current_folder_are_ignored(tmp_path):
    """Regression: numba overwrote any file that the folder of a stranger named; a pipe was waited for without end."""
    precious = tmp_path / "precious"
    precious.write_text("precious")
    folder = tmp_path / "strangers"
    folder.mkdir()
    (folder / ".numba_config.yaml").write_text(f"chrome_trace: {precious}\ndisable_jit: 1\n")
    for name in ("matplotlibrc", ".ncrc", ".daprc", ".dodsrc"):
        os.mkfifo(folder / name)
    (folder / "study.toml").write_text(
        '[study]\nname = "x"\n[base]\nmodel = "equilibrium"\n[factors.torque_n_m]\nvalues = [20, 40, 60]\n'
    )
    done = subprocess.run(
        [COMMAND, "run", "study.toml", "--untrusted", "--out", "out"],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=100,
    )
    assert done.returncode == 0, done.stderr
    assert precious.read_text() == "precious"


@pytest.mark.slow
def test_the_folder_of_temporary_files_of_others_is_not_used_by_workers(bench, tmp_path):
    """Regression: Dask's scheduler emptied the file that a link in /tmp/dask-scratch-space led to, and imported there."""
    shared, precious = tmp_path / "shared", tmp_path / "precious"
    (shared / "dask-scratch-space").mkdir(parents=True)
    precious.write_text("precious")
    for name in ("global.lock", "purge.lock"):
        (shared / "dask-scratch-space" / name).symlink_to(precious)
    words = ["run", "study.toml", "--workers", "1", "--out", str(tmp_path / "out")]
    assert called(words, bench, {"TMPDIR": str(shared)}).returncode == 0
    assert precious.read_text() == "precious"
    assert sorted(path.name for path in (shared / "dask-scratch-space").iterdir()) == ["global.lock", "purge.lock"]
