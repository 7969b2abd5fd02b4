"""Damaged files of a result directory: refused by readers, named by check, made anew by the next run."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
from contextlib import contextmanager
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr

import tripod_doe as td
from slow_cases import first_fast
from tripod_doe.cli import main
from tripod_doe.errors import CubeError
from tripod_doe.files.checksum_list import write_listed
from tripod_doe.study.cube import file_checks
from tripod_doe.study.cube.file_digest import is_damaged, is_sealed
from tripod_doe.study.cube.lazy_dataset import read_dataset
from tripod_doe.study.cube.netcdf import write_dataset
from tripod_doe.study.result_directory.check import check_files
from tripod_doe.study.result_directory.stored_study import stored_study, texts_of_study

pytestmark = pytest.mark.usefixtures("pages_not_made", "charts_not_drawn")

STUDY = """
[study]
name = "checked"
[base]
model = "equilibrium"
[factors]
joint_angle_deg = {low = 4, high = 12}
groove_sliding_friction = {low = 0.04, high = 0.08}
[design]
kind = "saltelli"
samples = 4
[run]
block = 4
[analysis.sobol]
"""
FILES = ("cube.nc", "cost.nc", "analysis/sobol.nc", "journal.sqlite")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("checked")
    (folder / "checked.toml").write_text(STUDY)
    code = main(["run", str(folder / "checked.toml"), "--out", str(folder / "out"), "--workers", "0"])
    assert code == 0
    return folder


@pytest.fixture(scope="module")
def other(whole, tmp_path_factory):
    """Results of another study."""
    folder = tmp_path_factory.mktemp("other")
    (folder / "other.toml").write_text(STUDY.replace("high = 12", "high = 13"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tripod_doe.workflow.run_study.write_report", lambda directory, findings: None)
        assert main(["run", str(folder / "other.toml"), "--out", str(folder / "out"), "--workers", "0"]) == 0
    return folder / "out"


@pytest.fixture
def folder(whole, tmp_path):
    return shutil.copytree(whole, tmp_path / "copy")


def flip(path, bit):
    content = bytearray(path.read_bytes())
    content[bit // 8] ^= 1 << bit % 8
    path.write_bytes(content)


@pytest.mark.parametrize("lost", [*FILES[:3], "study.toml"])
def test_a_file_that_is_gone_is_named(folder, capsys, lost):
    """Regression: it was not named, and the rest was all there is."""
    out = folder / "out"
    (out / lost).unlink()
    assert main(["check", str(out)]) == 3
    said = capsys.readouterr().out
    assert f"missing  {out / lost}: it was written, but is not here; run the study again" in said
    assert said.count("missing") == 1
    assert main(["run", str(folder / "checked.toml"), "--out", str(out), "--workers", "0"]) == 0
    assert "0 points computed" in capsys.readouterr().err
    assert main(["check", str(out)]) == 0


def answer(path):
    """What readers make of a directory or file: a message, or all values, attributes and names."""
    try:
        return "", td.open_cube(path)
    except td.CubeError as error:
        return str(error), None


@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize("seed", first_fast(range(3), 1))
def test_a_flipped_bit_is_refused_or_harmless(folder, whole, capsys, file, seed):
    """Regression: of 40 flips of cube.nc 17 were served in silence, of cost.nc 20, of an analysis 3."""
    path = folder / "out" / file
    asked = path if file.startswith("analysis") else folder / "out"
    flip(path, random.Random(seed).randrange(8 * path.stat().st_size))
    message, read = answer(asked)
    variable = "ST" if file.startswith("analysis") else "steps"
    code = main(["query", str(asked), "--variable", variable])
    errors = capsys.readouterr().err
    if message:
        assert code == 2
        assert path.name in message
        assert path.name in errors
    else:
        assert code == 0
        _, before = answer(whole / asked.relative_to(folder))
        assert read.identical(before)
    if path.suffix == ".nc":
        assert message


@pytest.mark.parametrize("file", first_fast(FILES, 1))
def test_check_names_a_damaged_file_and_the_next_run_mends_it(folder, capsys, file):
    out = folder / "out"
    before = td.open_cube(out)
    assert main(["check", str(out)]) == 0
    assert capsys.readouterr().out.count("intact") == 7
    path = out / file
    flip(path, 8 * path.read_bytes().index(b"outputs" if file == "journal.sqlite" else b"units"))
    assert main(["check", str(out), "--format", "json"]) == 3
    (damaged,) = (entry for entry in json.loads(capsys.readouterr().out) if entry["damage"])
    assert damaged["file"] == str(path)
    assert "run the study again with the same --out" in damaged["damage"]
    assert main(["run", str(folder / "checked.toml"), "--out", str(out), "--workers", "0"]) == 0
    errors = capsys.readouterr().err
    assert ("the journal is damaged" in errors) == (file == "journal.sqlite")
    assert main(["check", str(out)]) == 0
    after = td.open_cube(out)
    assert after["thrust_amplitude"].equals(before["thrust_amplitude"])


@pytest.mark.slow
def test_a_study_file_that_changed_in_the_directory_is_named_and_stored_again(folder, capsys):
    """Its text decides which points the results belong to."""
    out = folder / "out"
    text = (out / "study.toml").read_text()
    (out / "study.toml").write_text(text.replace("high = 12", "high = 13"))
    (out / "cube.nc").unlink()
    assert main(["query", str(out), "--variable", "outcome"]) == 2
    assert "study.toml: damaged or edited" in capsys.readouterr().err
    assert main(["check", str(out)]) == 3
    assert f"damaged  {out / 'study.toml'}: damaged or edited" in capsys.readouterr().out
    assert main(["run", str(folder / "checked.toml"), "--out", str(out), "--workers", "0"]) == 0
    assert "0 points computed" in capsys.readouterr().err
    assert (out / "study.toml").read_text() == text


def test_no_number_is_made_of_a_study_file_that_changed(folder, tmp_path, capsys):
    """Regression: derive certified another order as the response of that name, and view moved a joint at 900 N m."""
    out = shutil.copytree(folder / "out", tmp_path / "out")
    text = (out / "study.toml").read_text()
    (out / "study.toml").write_text(text.replace("high = 12", "high = 13"))
    (tmp_path / "added.toml").write_text('[responses.third]\nformula = "thrust_amplitude[3]"\n')
    before = (out / "cube.nc").read_bytes()
    for words in (
        ["derive", str(out), str(tmp_path / "added.toml")],
        ["view", str(out), "--output", str(tmp_path / "view.html")],
        ["report", str(out), "--motion"],
    ):
        assert main(words) == 2, words
        assert "study.toml: damaged or edited" in capsys.readouterr().err
    for reader in (stored_study, texts_of_study):
        with pytest.raises(CubeError, match=r"study\.toml: damaged or edited"):
            reader(out)
    assert (out / "cube.nc").read_bytes() == before


@pytest.fixture
def cube(tmp_path):
    """A cube by itself, without names of texts that HDF5 stores elsewhere."""
    path = tmp_path / "cube.nc"
    data = xr.Dataset({"y": (("x", "k"), np.random.default_rng(0).normal(size=(300, 400)))}, {"x": np.arange(300.0)})
    write_dataset(data, path)
    return path


def test_a_file_whose_checksum_is_gone_has_those_of_its_chunks(cube):
    """As after a change by another program: names and attributes are no longer checked, values are."""
    with netCDF4.Dataset(cube, "a") as stored:
        stored.comment = "changed"
    assert not is_sealed(cube)
    assert read_dataset(cube).attrs["comment"] == "changed"
    (checked,) = check_files(cube)
    assert checked.is_whole
    assert "without a checksum" in checked.note
    flip(cube, 8 * (cube.stat().st_size // 2))
    (checked,) = check_files(cube)
    assert "not a readable cube" in checked.damage
    with pytest.raises(td.CubeError, match="not a readable cube"):
        read_dataset(cube)


def test_coordinates_have_checksums_too(cube):
    with netCDF4.Dataset(cube) as stored:
        for variable in stored.variables.values():
            assert variable.filters()["fletcher32"]
            assert variable.chunking() != "contiguous"


def test_a_large_cube_that_is_read_in_parts_is_checked_part_by_part(cube, monkeypatch, capsys):
    monkeypatch.setattr(file_checks, "MOST_CHECKED", 1000)
    flip(cube, 8 * (cube.stat().st_size // 2))
    assert main(["query", str(cube), "--variable", "y", "--select", "x=3"]) == 2
    assert "cube.nc: not a readable cube" in capsys.readouterr().err
    with (
        td.open_cube(cube, chunks={}) as opened,
        pytest.raises(td.CubeError, match=r"cube\.nc: not a readable cube \(NetCDF: "),
    ):
        opened.load()


def test_a_file_that_changed_is_read_again(cube):
    assert not is_damaged(cube)
    flip(cube, 8 * 3000)
    assert is_damaged(cube)


@pytest.mark.parametrize("place", ["missing", "."])
def test_where_nothing_can_be_checked_that_is_said(tmp_path, capsys, place):
    assert main(["check", str(tmp_path / place)]) == 2
    errors = capsys.readouterr().err
    assert "there is no such file" in errors or "no file with a checksum here" in errors


@pytest.mark.parametrize("file", first_fast(["cube.nc", "cost.nc", "analysis/sobol.nc"], 1))
def test_results_of_another_study_are_not_those_of_the_directory(folder, other, capsys, file):
    """They are made of the journal, as while a study runs; a report says how an analysis is made anew."""
    out = folder / "out"
    before = td.open_cube(out)
    shutil.copy(other / file, out / file)
    assert [checked.path.name for checked in check_files(out) if not checked.is_whole] == [Path(file).name]
    read = td.open_cube(out)
    assert read["thrust_amplitude"].equals(before["thrust_amplitude"])
    assert read["cpu_seconds"].equals(before["cpu_seconds"])
    capsys.readouterr()
    refused = file.startswith("analysis")
    commands = [["report", str(out)], ["query", str(out / file), "--variable", "ST" if refused else "outcome"]]
    for command in commands[: 2 if refused else 1]:
        assert main(command) == (2 if refused else 0)
        assert ("its results are of another study" in capsys.readouterr().err) == refused
    for read_file in (td.open_cube, read_dataset):
        with pytest.raises(td.CubeError, match="its results are of another study"):
            read_file(out / file)


@pytest.mark.parametrize("lost", first_fast(["last sector", "last sector, and one of texts", "the checksum alone"], 1))
def test_a_result_without_its_checksum_is_refused_and_made_anew(folder, capsys, lost):
    """Texts vanished in silence, or HDF5 looped for ever, as a file without a checksum counted as whole."""
    out, before, damaged = folder / "out", {}, {}
    reason = "the checksum at its end is missing" if lost == "the checksum alone" else "does not match its checksum"
    for file in ("cube.nc", "cost.nc", "analysis/sobol.nc"):
        asked, whole = out / file if file.startswith("analysis") else out, (out / file).read_bytes()
        before[asked] = answer(asked)[1]
        damaged[out / file] = without_checksum(bytearray(whole), lost)
        (out / file).write_bytes(damaged[out / file])
        message, read = answer(asked)
        assert read is None
        assert reason in message
        assert [checked.path for checked in check_files(out) if not checked.is_whole] == [out / file]
        capsys.readouterr()
        loose = folder / "loose.nc"
        loose.write_bytes(damaged[out / file])
        assert (main(["check", str(loose)]) == 3) == (lost != "the checksum alone")
        said = "names, attributes and texts are not checked" in capsys.readouterr().out
        assert said == (lost == "the checksum alone")
        (out / file).write_bytes(whole)
    for path, content in damaged.items():
        path.write_bytes(content)
    assert main(["run", str(folder / "checked.toml"), "--out", str(out), "--workers", "0"]) == 0
    assert all(checked.is_whole for checked in check_files(out))
    for asked, read in before.items():
        assert answer(asked)[1].equals(read)


def without_checksum(content, lost):
    """The content of a file that has lost its last 512 bytes, a part with texts too, or its checksum alone."""
    if lost == "the checksum alone":
        del content[-83:]
        return content
    end = (len(content) - 1) // 512 * 512
    content[end:] = bytes(len(content) - end)
    if lost.endswith("texts"):
        heap = content.index(b"GCOL") // 512 * 512
        content[heap : heap + 512] = bytes(512)
    return content


@pytest.mark.parametrize(
    "file",
    first_fast([*FILES, "study.toml", "report/index.html", ".lock", "journal.sqlite-wal", "journal.sqlite-journal"], 4),
)
@pytest.mark.parametrize("kind", first_fast(["pipe", "device"], 1))
def test_what_is_no_file_is_refused_and_not_opened(folder, capsys, file, kind):
    """A pipe held up every command, and a device filled the memory."""
    out = folder / "out"
    (out / file).parent.mkdir(exist_ok=True)
    (out / file).unlink(missing_ok=True)
    if kind == "pipe":
        os.mkfifo(out / file)
    else:
        (out / file).symlink_to("/dev/zero")
    commands = [["query", str(out), "--variable", "outcome"], ["check", str(out)], ["report", str(out)]]
    commands += [["query", str(out / file), "--variable", "ST"]] if file.startswith("analysis") else []
    commands += [["run", str(folder / "checked.toml"), "--out", str(out), "--workers", "0"]] if kind == "pipe" else []
    with within(30):
        codes = [main(command) for command in commands]
    assert set(codes) <= {0, 1, 2, 3}
    assert "internal error" not in capsys.readouterr().err
    assert (codes[1] == 3) == (
        "sqlite" in file or (kind == "pipe" and file in (*FILES, "study.toml", "report/index.html"))
    )


@pytest.mark.parametrize("file", ["study.toml", "report/index.html"])
def test_a_sparse_text_is_refused_by_its_size(folder, capsys, file):
    """Regression: 60 GB that take no place on the disk were read, into memory or for their checksum."""
    out = folder / "out"
    write_listed(out / "report" / "index.html", "a page")
    os.truncate(out / file, 60_000_000_000)
    assert main(["check", str(out)]) == 3
    assert f"{file}: 60,000,000,000 bytes, at most" in " ".join(capsys.readouterr().out.split())


@contextmanager
def within(seconds):
    """A limit of time, also for what waits in the system."""

    def late(*_):
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def test_links_are_named(folder, capsys):
    out = folder / "out"
    (out / "cost.nc").rename(folder / "elsewhere.nc")
    (out / "cost.nc").symlink_to(folder / "elsewhere.nc")
    assert main(["check", str(out)]) == 0
    assert f"skipped  {out / 'cost.nc'}: a symbolic link" in capsys.readouterr().out
    (folder / "link").symlink_to(out)
    assert main(["check", str(folder / "link")]) == 0
    assert "cube.nc" in capsys.readouterr().out


def test_texts_of_a_file_without_a_checksum_are_read_by_check(whole, tmp_path):
    """Their type has no size: an error of Python was shown as damage."""
    loose = tmp_path / "loose.nc"
    loose.write_bytes((whole / "out" / "analysis" / "sobol.nc").read_bytes()[:-83])
    (checked,) = check_files(loose)
    assert checked.is_whole


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 12))])
def test_damage_without_a_checksum_ends_with_a_message(folder, capsys, seed):
    """Of names and attributes, where the digest is gone: netCDF4 raises errors of many kinds."""
    cube = folder / "cube.nc"  # in the result directory it would be refused
    content = (folder / "out" / "cube.nc").read_bytes()[:-83]
    places = [at for at in range(len(content)) if content[at : at + 2] == b"OH"]  # headers of variables
    rng = random.Random(seed)
    place = rng.choice(places)
    damaged = bytearray(content)
    damaged[place + rng.randrange(600)] ^= 1 << rng.randrange(8)
    cube.write_bytes(damaged)
    code = main(["query", str(cube), "--variable", "thrust_amplitude"])
    assert code in (0, 2)
    assert "internal error" not in capsys.readouterr().err


@pytest.mark.parametrize(("name", "depth"), [("a", 1100), ("a" * 200, 25)])
def test_deep_folders_are_checked_as_far_as_the_system_reaches(tmp_path, capsys, name, depth):
    """Regression: folders nested deeper than Python calls, and paths longer than the system takes, were internal errors."""
    place = os.open(tmp_path, os.O_RDONLY)
    for _ in range(depth):
        os.mkdir(name, dir_fd=place)
        inner = os.open(name, os.O_RDONLY, dir_fd=place)
        os.close(place)
        place = inner
    os.close(place)
    write_listed(tmp_path / "z.toml", "")
    is_long = len(name) > 1
    assert main(["check", str(tmp_path)]) == (3 if is_long else 0)
    said = capsys.readouterr().out
    assert ("cannot be read: File name too long" in said) == is_long
    assert f"intact   {tmp_path}/z.toml" in said
    subprocess.run(["rm", "-r", str(tmp_path / name)], check=True)  # which Python cannot
