"""The journal: what was committed is there once, whatever is killed, full, damaged or started twice."""

from __future__ import annotations

import errno
import os
import random
import resource
import shutil
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import tripod_doe as td
from tripod_doe.errors import StorageError
from tripod_doe.simulator import BlockResult, Outcome, Retries
from tripod_doe.study import journal as journals
from tripod_doe.study.block_record import FinishedBlock, encode
from tripod_doe.study.directory import ResultDirectory
from tripod_doe.study.journal import SHOWN, Journal, Mark
from tripod_doe.study.results import is_shown

pytestmark = pytest.mark.usefixtures("pages_not_made")

EARLIER = Path(__file__).parent / "earlier_journal"


def block(number, points=2):
    """A block whose every value follows from its number."""
    keys = np.frombuffer(b"".join(f"point {number:5} {row:4}".encode() for row in range(points)), "V16")
    result = BlockResult.blank(points, Outcome.FINISHED)
    result.put("y", ("place",), slice(None), number + np.arange(points)[:, None] + np.arange(30.0))
    result.coordinates["place"] = np.array([f"place {index}" for index in range(30)])
    result.detail[0] = f"a note on {number}"
    return FinishedBlock(keys, result, 1.0, 2.0, f"worker {number}")


def numbers(journal):
    """Blocks in a journal by their number, each held against what was written."""
    found = []
    for stored in journal.blocks():
        number = int(stored.worker.removeprefix("worker "))
        written = block(number)
        assert stored.keys.tobytes() == written.keys.tobytes()
        assert stored.result.detail == written.result.detail
        np.testing.assert_array_equal(stored.result.outputs["y"].data, written.result.outputs["y"].data)
        np.testing.assert_array_equal(stored.result.coordinates["place"], written.result.coordinates["place"])
        found.append(number)
    assert journal.keys().size == 2 * len(found)
    return found


def reopened(folder):
    with Journal(folder) as journal:
        return numbers(journal)


def test_a_block_comes_back_as_it_was(tmp_path):
    result = BlockResult.blank(3, Outcome.DIVERGED, "why")
    result.detail[1] = "why not"
    result.settled["step_s"] = np.array([1e-5, np.nan, 2e-5])
    used = {"model": np.array(["rollers", "", "needles"]), "step_s": np.array([1e-5, np.nan, 1.0])}
    retries = Retries(np.array([0, 1, 2], np.int8), np.zeros(3, np.int8), ["", "first", ""], used)
    result = BlockResult(**(vars(result) | {"retries": retries}))
    with Journal(tmp_path) as journal:
        journal.commit(FinishedBlock(block(0, 3).keys, result, 0.1, 0.2, "w"))
        (stored,) = journal.blocks()
        journal.note_shown()
        (archived,) = journal.blocks()
    for answer in (stored, archived):
        assert answer.keys.tobytes() == block(0, 3).keys.tobytes()
        assert (answer.cpu_seconds, answer.wall_seconds, answer.worker) == (0.1, 0.2, "w")
        assert answer.result.detail == ["why", "why not", "why"]
        assert answer.result.retries.first_detail == ["", "first", ""]
        assert answer.result.outputs == {}
        for name, column in used.items():
            np.testing.assert_array_equal(answer.result.retries.used[name], column)
        np.testing.assert_array_equal(answer.result.settled["step_s"], result.settled["step_s"])


class Killed(BaseException):
    """Stands for SIGKILL."""


@contextmanager
def kill_at(monkeypatch, call):
    """End this process in a call of the system, of those that write: half of what it should write is written."""
    calls = iter(range(1, 10_000))

    def dying(name, function):
        def called(*arguments, **options):
            if next(calls) != call:
                return function(*arguments, **options)
            if name == "write":
                function(arguments[0], arguments[1][: len(arguments[1]) // 2])
            raise Killed

        return called

    with monkeypatch.context() as patch:
        for name in ("write", "fsync", "replace"):
            patch.setattr(os, name, dying(name, getattr(os, name)))
        patch.setattr(shutil, "rmtree", dying("rmtree", shutil.rmtree))
        try:
            yield
        except Killed:
            return
        pytest.skip("this run has fewer calls")


@pytest.mark.parametrize("call", range(1, 30))
def test_a_kill_in_any_call_that_writes_loses_nothing_and_doubles_nothing(tmp_path, monkeypatch, call):
    """Runs with three and two blocks that end in the archive, and one that does not; then a run goes on."""
    monkeypatch.setattr(journals, "_BATCH_SECONDS", 0.0)  # every block by itself
    committed = []
    with kill_at(monkeypatch, call):
        for run in ((0, 1, 2), (3, 4), (5,)):
            journal = Journal(tmp_path)
            journal.remember({"computing": str(run)})
            for number in run:
                journal.commit(block(number))
                committed.append(number)
            if run != (5,):
                journal.note_shown()
                assert journal.recall(SHOWN) == journal.state() == str(len(committed))
    with Journal(tmp_path) as journal:
        left = numbers(journal)
        assert left in (committed, [*committed, len(committed)])
        journal.commit(block(9))
        assert numbers(journal) == [*left, 9]
        journal.note_shown()
        assert numbers(journal) == [*left, 9]
    assert sorted(path.name for path in tmp_path.iterdir() if not path.name.startswith(".")) == ["journal.sqlite"]


def written_segment(folder, count=60):
    with Journal(folder) as journal:
        for number in range(count):
            journal.commit(block(number))
    (segment,) = (folder / "journal").glob("*.blocks")
    return segment


@pytest.mark.parametrize("seed", range(30))
def test_a_segment_that_is_cut_zeroed_or_flipped_loses_what_was_hit_and_tells(tmp_path, capsys, seed):
    rng, segment = random.Random(seed), written_segment(tmp_path)
    content = bytearray(segment.read_bytes())
    ends = np.cumsum([len(encode(block(number), number)) for number in range(60)])
    start, length = rng.randrange(len(content)), rng.choice([1, 100, 5000])
    assert ends[-1] == len(content)
    if seed % 3 == 0:
        del content[start:]
        whole = list(range(np.searchsorted(ends, start, side="right")))
    else:
        start = next(at for at in range(start, len(content)) if content[at])  # a zero is no damage to a zero
        flipped = bytes(byte ^ 0xFF for byte in content[start : start + length])
        content[start : start + length] = bytes(len(flipped)) if seed % 3 == 1 else flipped
        first, last = np.searchsorted(ends, [start, start + len(flipped) - 1], side="right")
        whole = [*range(first), *range(last + 1, 60)]
    segment.write_bytes(content)
    ResultDirectory(tmp_path).close()
    told = capsys.readouterr().err
    assert reopened(tmp_path) == whole
    assert "what is lost is computed again" in told
    ResultDirectory(tmp_path).close()
    assert capsys.readouterr().err == ""  # told once


def test_two_that_write_at_once_share_no_file_and_damage_nothing(tmp_path):
    """As where a lock does not work; what the first one appends after the second came does not count."""
    first = Journal(tmp_path)
    first.commit(block(0))
    second = Journal(tmp_path)
    second.commit(block(1))
    first.commit(block(2))
    second.commit(block(3))
    assert numbers(second) == [0, 1, 3]
    first.close()
    second.note_shown()
    second.close()
    assert reopened(tmp_path) == [0, 1, 3]


def test_a_journal_of_an_earlier_version_is_read_and_goes_on(tmp_path, capsys):
    """Regression data: SQLite with a write-ahead log, left by a kill after two of three blocks."""
    shutil.copytree(EARLIER, tmp_path / "out")
    code = (tmp_path / "out" / "earlier_function.py").rename(tmp_path / "earlier_function.py")
    (tmp_path / "out" / "study.toml").rename(tmp_path / "study.toml")
    before = Journal(tmp_path / "out", read_only=True)
    assert before.keys().size == 4
    before.close()
    summary = td.run(tmp_path / "study.toml", tmp_path / "out", workers=0, progress=False)
    assert code.exists()
    assert (summary.computed, summary.reused) == (1, 4)
    cube = td.open_cube(tmp_path / "out")
    np.testing.assert_array_equal(cube["y"], [1, 4, np.nan, 16, 25])
    np.testing.assert_array_equal(cube["z"][3], [4, 8])
    assert str(cube["outcome_detail"].values[2]) == "ValueError: three"
    assert is_shown(tmp_path / "out")
    assert {path.name for path in (tmp_path / "out").glob("journal*")} == {"journal.sqlite"}
    assert "damaged" not in capsys.readouterr().err


def test_large_journals_stay_in_segments(tmp_path, monkeypatch):
    """They are not copied when a run ends; their state is known without reading them."""
    monkeypatch.setattr(journals, "_GATHERED", 5_000)
    for run in range(3):
        with Journal(tmp_path) as journal:
            for number in range(4 * run, 4 * run + 4):
                journal.commit(block(number))
            journal.note_shown()
            assert journal.recall(SHOWN) == journal.state()
    assert len(list((tmp_path / "journal").glob("*.blocks"))) == 3
    with Journal(tmp_path, read_only=True) as journal:
        assert journal.recall(SHOWN) == journal.state() != "0"
        assert numbers(journal) == list(range(12))


def test_a_reader_gets_what_is_new_and_all_again_after_blocks_were_gathered(tmp_path):
    writer, mark, seen = Journal(tmp_path), Mark(), []

    def read():
        nonlocal mark
        with Journal(tmp_path, read_only=True) as reader:
            again, ends, mark = reader.news(mark)
        if again:
            seen.clear()
        seen.extend(int(end.keys.tobytes()[6:11]) for end in ends)
        return again, len(ends)

    writer.commit(block(0))
    writer.commit(block(1))
    assert read() == (False, 2)
    assert read() == (False, 0)
    writer.commit(block(2))
    assert read() == (False, 1)
    writer.note_shown()
    writer.commit(block(3))
    assert read() == (True, 4)
    assert seen == [0, 1, 2, 3]
    writer.close()


def test_a_full_disk_ends_the_run_and_leaves_whole_blocks(tmp_path, monkeypatch):
    journal, write = Journal(tmp_path), os.write
    journal.commit(block(0))

    def full(file, text):
        write(file, text[:100])
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "write", full)
        with pytest.raises(StorageError, match=r"No space left on device.*finished points are kept: free space"):
            journal.commit(block(1))
    journal.commit(block(2))
    assert numbers(journal) == [0, 2]
    journal.close()
    assert reopened(tmp_path) == [0, 2]


def test_a_note_that_cannot_be_stored_is_told_as_such(tmp_path):
    journal = Journal(tmp_path)
    (tmp_path / "journal").write_text("no folder")
    with pytest.raises(StorageError, match="cannot write this file"):
        journal.remember({"computing": "yes"})
    journal.close()


def test_blocks_of_a_second_share_one_sync_and_none_waits_longer(tmp_path, monkeypatch):
    monkeypatch.setattr(journals, "_BATCH_SECONDS", 0.3)
    journal, synced, sync = Journal(tmp_path), [], os.fsync
    journal.commit(block(0))
    monkeypatch.setattr(os, "fsync", lambda file: (synced.append(file), sync(file)))
    for number in range(1, 50):
        journal.commit(block(number))
    assert len(synced) <= 1
    time.sleep(0.6)
    assert 1 <= len(synced) <= 2
    journal.close()
    assert 1 <= len(synced) <= 2


def test_a_disk_that_fails_later_is_told_at_the_next_block(tmp_path, monkeypatch):
    monkeypatch.setattr(journals, "_BATCH_SECONDS", 0.1)
    journal = Journal(tmp_path)
    journal.commit(block(0))

    def broken(file):
        raise OSError(errno.EIO, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", broken)
        journal.commit(block(1))
        time.sleep(0.3)
    with pytest.raises(StorageError, match="Input/output error"):
        journal.commit(block(2))
    journal.close()


def test_a_journal_of_many_blocks_keeps_none_of_them_open(tmp_path):
    """Regression: what was read of each block kept it mapped, and with it an open file."""
    open_files = resource.getrlimit(resource.RLIMIT_NOFILE)
    with Journal(tmp_path) as journal:
        for number in range(300):
            journal.commit(block(number))
        resource.setrlimit(resource.RLIMIT_NOFILE, (200, open_files[1]))
        try:
            assert journal.keys().size == 600
            assert len(journal.news(Mark())[1]) == 300
            assert sum(read().keys.size for read in journal.places()) == 600
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, open_files)
