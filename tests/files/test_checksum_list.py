"""Text files of results: their checksums are written with them, and held before anything reads or delivers them."""

import fcntl
import itertools
import json
import os
import subprocess
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import pytest

from tripod_doe.cli import main
from tripod_doe.errors import CubeError
from tripod_doe.files.checksum_list import LIST, checksums, is_changed, refuse_changed, write_listed


def flip(path, text):
    """Change one bit of the last letter of a text that stands in a file."""
    content = bytearray(path.read_bytes())
    content[content.index(text.encode()) + len(text) - 1] ^= 1
    path.write_bytes(content)


def test_a_list_is_as_sha256sum_reads_it(tmp_path):
    for name in ("b.toml", "a.html", "b.toml"):
        write_listed(tmp_path / name, f"{name} ü\n")
    done = subprocess.run(["sha256sum", "--check", "--strict", LIST], cwd=tmp_path, check=True, capture_output=True)
    assert done.stdout.decode().splitlines() == ["a.html: OK", "b.toml: OK"]


def test_a_changed_file_is_refused_with_the_remedy(tmp_path):
    page, base = tmp_path / "report" / "index.html", tmp_path / "base.toml"
    write_listed(page, "1.5 N")
    write_listed(base, "a = 1.5")
    (tmp_path / "fit.nc").touch()
    flip(page, "1.5")
    flip(base, "1.5")
    with pytest.raises(CubeError, match=f"make it again: tripod-doe report {tmp_path};"):
        refuse_changed(page)
    with pytest.raises(CubeError, match="the same command with the same out"):
        refuse_changed(base)
    write_listed(page, "1.5 N")
    refuse_changed(page)


def test_a_study_is_not_read_from_a_changed_file(tmp_path, capsys):
    """Regression: a bit that flipped in a tolerance.toml of a fit was planned as it was."""
    study = write_listed(
        tmp_path / "tolerance.toml", '[study]\nname = "a"\n[factors]\njoint_angle_deg = {values = [8.5]}\n'
    )
    assert main(["plan", "--no-timing", str(study)]) == 0
    flip(study, "8.5")
    capsys.readouterr()
    assert main(["plan", "--no-timing", str(study)]) == 2
    assert "damaged or edited" in capsys.readouterr().err
    study.rename(tmp_path / "mine.toml")
    assert main(["plan", "--no-timing", str(tmp_path / "mine.toml")]) == 0


def test_a_table_is_not_read_from_a_changed_file(tmp_path, capsys):
    (tmp_path / "s.toml").write_text('[study]\nname = "a"\n[design]\nkind = "table"\ntable = "t.csv"\n')
    table = write_listed(tmp_path / "t.csv", "joint_angle_deg\n8.5\n")
    flip(table, "8.5")
    assert main(["plan", "--no-timing", str(tmp_path / "s.toml")]) == 2
    assert "t.csv: damaged or edited" in capsys.readouterr().err


def test_check_names_changed_and_missing_files_and_lines(tmp_path, capsys):
    for name in ("a.html", "b.toml", "c.json"):
        write_listed(tmp_path / name, "text 7")
    flip(tmp_path / "a.html", "7")
    (tmp_path / "b.toml").unlink()
    (tmp_path / LIST).write_text((tmp_path / LIST).read_text() + "damaged line\n")
    assert main(["check", str(tmp_path), "--format", "json"]) == 3
    checked = {entry["file"].rpartition("/")[2]: entry for entry in json.loads(capsys.readouterr().out)}
    assert "damaged or edited" in checked["a.html"]["damage"]
    assert "but not here" in checked["b.toml"]["damage"]
    assert not checked["c.json"]["damage"]
    assert "1 of its lines are damaged" in checked[LIST]["damage"]
    write_listed(tmp_path / "a.html", "text 7")  # what is damaged does not stay in the list
    (tmp_path / "b.toml").touch()
    assert main(["check", str(tmp_path / "a.html")]) == 0
    assert checksums(tmp_path).keys() == {"a.html", "b.toml", "c.json"}


def test_a_pipe_in_place_of_the_list_is_refused(tmp_path, capsys):
    os.mkfifo(tmp_path / LIST)
    (tmp_path / "a.toml").write_text("")
    with pytest.raises(CubeError, match="a pipe"):
        refuse_changed(tmp_path / "a.toml")
    assert main(["check", str(tmp_path)]) == 3
    assert "a pipe" in capsys.readouterr().out


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_a_kill_at_any_moment_damages_no_file(tmp_path, monkeypatch, count):
    """Regression: after a kill between a file and its list, the file was "damaged or edited"."""
    path, other = tmp_path / "base.toml", tmp_path / "other.toml"
    write_listed(path, "old")
    replace, calls = os.replace, itertools.count(1)

    def killed(*places):
        if next(calls) == count:
            raise KeyboardInterrupt
        replace(*places)

    with monkeypatch.context() as patched, suppress(KeyboardInterrupt):
        patched.setattr(os, "replace", killed)
        write_listed(path, "new")
    refuse_changed(path)
    text = path.read_text()
    assert text == ("new" if count > 2 else "old")
    write_listed(other, "")
    refuse_changed(path)
    flip(path, text)
    with pytest.raises(CubeError):
        refuse_changed(path)


def test_a_page_without_a_checksum_is_refused_where_one_is_due(tmp_path):
    """Regression: the service delivered a page whose list was removed without a word."""
    path = write_listed(tmp_path / "index.html", "text")
    refuse_changed(path, unlisted=True)
    (tmp_path / LIST).rename(tmp_path / f".{LIST}.next")  # killed before the list was in its place
    refuse_changed(path, unlisted=True)
    (tmp_path / f".{LIST}.next").unlink()
    refuse_changed(path)
    with pytest.raises(CubeError, match="does not match its checksum"):
        refuse_changed(path, unlisted=True)


def test_a_damaged_file_is_known_at_once(tmp_path):
    """Regression: each look at the list of runs waited a second for the steps of a damaged one."""
    path = write_listed(tmp_path / "steps.json", "[1]")
    flip(path, "[1")
    began = time.process_time(), time.monotonic()
    assert is_changed(path)
    assert time.process_time() - began[0] < 0.5
    assert time.monotonic() - began[1] < 0.9


def test_a_file_is_not_called_changed_while_it_is_written(tmp_path):
    path, ended = tmp_path / "steps.json", threading.Event()

    def write():
        for count in range(20):
            write_listed(path, str(count))
            time.sleep(0.03)
        ended.set()

    writer = threading.Thread(target=write)
    writer.start()
    try:
        while not ended.is_set():
            assert not is_changed(path)
    finally:
        writer.join()


def test_writers_of_one_folder_wait_for_each_other(tmp_path):
    """Regression: half of the calls failed, and whole files counted as changed."""

    def write(name):
        for count in range(20):
            write_listed(tmp_path / name, f"{name} {count}")

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(write, "abcd"))
    assert sorted(checksums(tmp_path)) == list("abcd")
    assert not any(is_changed(tmp_path / name) for name in "abcd")


def test_who_may_only_read_a_folder_holds_no_writer_up(tmp_path):
    """Regression: another user's lock on the folder of a report stopped `report` and `run` for ever, without a word."""
    place = os.open(tmp_path, os.O_RDONLY)
    try:
        fcntl.flock(place, fcntl.LOCK_EX)
        writer = threading.Thread(target=write_listed, args=(tmp_path / "index.html", "text"), daemon=True)
        writer.start()
        writer.join(10)
        assert not writer.is_alive()
    finally:
        os.close(place)
    assert sorted(os.listdir(tmp_path)) == [LIST, "index.html"]
