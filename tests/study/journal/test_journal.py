"""The journal: what was committed is there once, whatever is killed, full or started twice."""

from __future__ import annotations

import os
import random
import signal
import sqlite3
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slow_cases import first_fast
from tripod_doe.errors import CubeError, StorageError
from tripod_doe.model_interface import BlockResult, Outcome, Retries
from tripod_doe.study.journal import KERNELS, SHOWN, FinishedBlock, Journal, Mark, journal_path


def block(number, points=2):
    """A block whose every value follows from its number."""
    keys = np.frombuffer(b"".join(f"point {number:5} {row:4}".encode() for row in range(points)), "V16")
    result = BlockResult.blank(points, Outcome.FINISHED)
    result.put("y", ("place",), slice(None), number + np.arange(points)[:, None] + np.arange(300.0))
    result.coordinates["place"] = np.array([f"place {index}" for index in range(300)])
    result.detail[0] = f"a note on {number}"
    return FinishedBlock(keys, result, 1.0, 2.0, f"worker {number}")


def numbers(journal):
    """Blocks in a journal by their number, each held against what was written."""
    seen = []
    for stored in journal.blocks():
        number = int(stored.worker.removeprefix("worker "))
        written = block(number)
        assert stored.keys.tobytes() == written.keys.tobytes()
        assert stored.result.detail == written.result.detail
        np.testing.assert_array_equal(stored.result.outputs["y"].data, written.result.outputs["y"].data)
        np.testing.assert_array_equal(stored.result.coordinates["place"], written.result.coordinates["place"])
        seen.append(number)
    assert journal.keys().size == 2 * len(seen)
    return seen


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
    with Journal(tmp_path, read_only=True) as journal:
        (reopened,) = journal.blocks()
        (placed,) = (read() for read in journal.places())
    for answer in (stored, reopened, placed):
        assert answer.keys.tobytes() == block(0, 3).keys.tobytes()
        assert (answer.cpu_seconds, answer.wall_seconds, answer.worker) == (0.1, 0.2, "w")
        assert answer.result.detail == ["why", "why not", "why"]
        assert answer.result.retries.first_detail == ["", "first", ""]
        assert answer.result.outputs == {}
        assert answer.result.outcome.tolist() == [Outcome.DIVERGED] * 3
        for name, column in used.items():
            np.testing.assert_array_equal(answer.result.retries.used[name], column)
        np.testing.assert_array_equal(answer.result.settled["step_s"], result.settled["step_s"])


WRITER = """
import sys
from pathlib import Path
sys.path[:0] = {folders!r}
from test_journal import Journal, block
with Journal(Path({folder!r})) as journal:
    for number in range({first}, 10_000):
        journal.remember({{"computing": str(number)}})
        journal.commit(block(number))
        print(number, flush=True)
"""


@pytest.mark.parametrize("seed", first_fast(range(6), 1))
def test_a_kill_at_any_moment_loses_nothing_and_doubles_nothing(tmp_path, seed):
    """SIGKILL of a process that writes block after block, three times; what it had reported is there."""
    moments, first = random.Random(seed), 0
    for _ in range(3):
        code = WRITER.format(folders=list(map(str, Path(__file__).parents[:3])), folder=str(tmp_path), first=first)
        writer = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
        reported = [int(writer.stdout.readline()) for _ in range(moments.randrange(1, 40))]
        time.sleep(moments.uniform(0.0, 0.01))
        os.kill(writer.pid, signal.SIGKILL)
        reported += [int(line) for line in writer.communicate()[0].split()]
        with Journal(tmp_path, read_only=True) as journal:
            left = numbers(journal)
        with Journal(tmp_path) as journal:
            assert journal.repaired == ""
            assert numbers(journal) == left
        assert left in (list(range(reported[-1] + 1)), list(range(reported[-1] + 2)))
        first = left[-1] + 1
    assert [path.name for path in tmp_path.iterdir()] == ["journal.sqlite"]


def test_a_closed_journal_is_one_file_that_is_read_where_nothing_can_be_written(tmp_path):
    with Journal(tmp_path) as journal:
        journal.commit(block(0))
    assert [path.name for path in tmp_path.iterdir()] == ["journal.sqlite"]
    tmp_path.chmod(0o500)
    with Journal(tmp_path, read_only=True) as journal:
        assert numbers(journal) == [0]
    assert [path.name for path in tmp_path.iterdir()] == ["journal.sqlite"]
    tmp_path.chmod(0o700)


def test_two_that_write_at_once_damage_nothing(tmp_path):
    """As where the lock of a directory does not work."""
    first = Journal(tmp_path)
    first.commit(block(0))
    second = Journal(tmp_path)
    second.commit(block(1))
    first.commit(block(2))
    second.commit(block(3))
    assert numbers(second) == [0, 1, 2, 3]
    first.close()
    second.note_shown()
    second.close()
    with Journal(tmp_path, read_only=True) as journal:
        assert numbers(journal) == [0, 1, 2, 3]


def test_a_reader_gets_what_is_new_while_a_run_writes(tmp_path):
    writer, mark, seen = Journal(tmp_path), Mark(), []

    def read():
        nonlocal mark
        with Journal(tmp_path, read_only=True) as reader:
            again, ends, mark = reader.news(mark)
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
    assert read() == (False, 1)
    assert seen == [0, 1, 2, 3]
    writer.close()


def test_a_reader_gets_all_again_after_a_repair(tmp_path):
    with Journal(tmp_path) as journal:
        for number in range(5):
            journal.commit(block(number))
        _, _, mark = journal.news(Mark())
    content = bytearray(journal_path(tmp_path).read_bytes())
    content[content.index(b"point     2")] ^= 1
    journal_path(tmp_path).write_bytes(content)
    Journal(tmp_path).close()
    with Journal(tmp_path, read_only=True) as journal:
        again, ends, mark = journal.news(mark)
        assert again
        assert [int(end.keys.tobytes()[6:11]) for end in ends] == [0, 1, 3, 4]
        assert journal.news(mark)[:2] == (False, [])


def test_the_state_tells_what_the_cube_shows(tmp_path):
    with Journal(tmp_path) as journal:
        assert journal.state() == "0"
        for number in range(2):
            journal.commit(block(number))
            assert journal.recall(SHOWN) != journal.state()
            journal.note_shown()
            assert journal.recall(SHOWN) == journal.state()


@pytest.fixture
def full_disk(tmp_path):
    """A journal whose file cannot grow."""
    journal = Journal(tmp_path)
    journal.commit(block(0))
    connection = journal._connection
    pages = connection.execute("PRAGMA page_count").fetchone()[0]
    connection.execute(f"PRAGMA max_page_count = {pages}")
    return journal


def test_a_full_disk_ends_the_run_and_leaves_whole_blocks(tmp_path, full_disk):
    with pytest.raises(StorageError, match=r"disk is full.*finished points are kept: free space"):
        full_disk.commit(block(1, 500))
    full_disk._connection.execute("PRAGMA max_page_count = 100000")
    full_disk.commit(block(9))
    assert numbers(full_disk) == [0, 9]
    full_disk.close()
    with Journal(tmp_path, read_only=True) as journal:
        assert numbers(journal) == [0, 9]


def test_a_journal_that_another_program_holds_is_said_to_be(tmp_path):
    """Regression: the remedy was to free space."""
    with Journal(tmp_path) as journal:
        other = sqlite3.connect(journal.path, timeout=0)
        other.execute("BEGIN IMMEDIATE")
        journal._connection.execute("PRAGMA busy_timeout = 0")
        with pytest.raises(StorageError, match="end the program that holds it, then run again"):
            journal.commit(block(1))
        other.close()
        journal.commit(block(1))


def test_a_journal_that_cannot_be_opened_is_no_damage(tmp_path):
    with Journal(tmp_path) as journal:
        journal.commit(block(0))
    journal_path(tmp_path).rename(tmp_path / "elsewhere")
    with pytest.raises(CubeError, match="cannot read the journal: unable to open database file"):
        Journal(tmp_path, read_only=True)


def test_a_block_names_the_kernels_that_computed_it(tmp_path):
    with Journal(tmp_path) as journal:
        journal.remember({KERNELS: "abc"})
        journal.commit(block(0))
        journal.remember({KERNELS: "def"})
        journal.commit(block(1))
    connection = sqlite3.connect(journal_path(tmp_path))
    assert connection.execute("SELECT kernels FROM block ORDER BY id").fetchall() == [("abc",), ("def",)]
    connection.close()


def test_long_blocks_are_synced_each_and_short_ones_together(tmp_path):
    """A power cut costs a second of work at most, and a study of many short points does not wait for the disk."""
    with Journal(tmp_path) as journal:
        asked = []
        journal._connection.set_trace_callback(asked.append)
        for seconds in (1.0, 0.001, 0.001, 1.0, 0.001):
            journal.commit(replace(block(0), wall_seconds=seconds))
        journal._synced_at -= 2.0
        journal.commit(replace(block(0), wall_seconds=0.001))
        journal._connection.set_trace_callback(None)
    levels = [text.split()[-1] for text in asked if "synchronous" in text]
    assert levels == ["FULL", "NORMAL", "NORMAL", "FULL", "NORMAL", "FULL"]


def test_a_journal_whose_page_was_half_written_at_a_kill_is_read_as_it_was_before(tmp_path):
    """Regression: killed while a run ended, it could not be read until the run went on."""
    with Journal(tmp_path) as journal:
        journal.commit(block(1))
    program = (
        "import os, signal, sqlite3, sys; c = sqlite3.connect(sys.argv[1], isolation_level=None);"
        " c.execute('PRAGMA cache_size = 1'); c.execute('BEGIN IMMEDIATE');"
        " c.execute('UPDATE block SET worker = ? || worker', ('x' * 500_000,));"
        " os.kill(os.getpid(), signal.SIGKILL)"
    )
    subprocess.run([sys.executable, "-c", program, str(journal_path(tmp_path))], check=False)
    assert (tmp_path / "journal.sqlite-journal").stat().st_size > 0
    with Journal(tmp_path, read_only=True) as journal:
        assert numbers(journal) == [1]


@pytest.mark.parametrize(("outcome", "seconds"), [(77, 1.0), (0, np.inf), (0, -1.0)])
def test_a_block_that_no_run_writes_is_damaged(tmp_path, outcome, seconds):
    """Regression: a service that met one in a stranger's directory logged a traceback at each look."""
    written = block(0)
    written.result.outcome[:] = outcome
    with Journal(tmp_path) as journal:
        journal.commit(replace(written, cpu_seconds=seconds))
    with pytest.raises(CubeError, match="damaged"), Journal(tmp_path, read_only=True) as journal:
        journal.check()
