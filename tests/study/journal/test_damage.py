"""Damaged journals: every whole block is kept, what is lost is stated and computed again, no wrong number is read."""

from __future__ import annotations

import gc
import random
import shutil
import sqlite3
import struct
import warnings
import zlib
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

import tripod_doe as td
from slow_cases import first_fast
from tripod_doe.cli import main
from tripod_doe.errors import CubeError
from tripod_doe.model_interface import BlockResult, Outcome
from tripod_doe.study.journal import KERNELS, SHOWN, FinishedBlock, Journal, damage, journal_path
from tripod_doe.study.journal.finished_block import decode, encode
from tripod_doe.study.journal.rows import BLOCK_COLUMNS, PAGE_BYTES, BlockRow
from tripod_doe.study.result_directory.directory import ResultDirectory

pytestmark = pytest.mark.usefixtures("pages_not_made")

BLOCKS = 60


def block(number):
    """Ten points whose output follows from their fingerprints: 24 kB, so that blocks and pages are about as large."""
    keys = np.frombuffer(b"".join(f"point {number:5} {row:4}".encode() for row in range(10)), "V16")
    result = BlockResult.blank(10, Outcome.FINISHED)
    result.put("y", ("place",), slice(None), number + np.arange(10.0)[:, None] + np.arange(300.0))
    result.coordinates["place"] = np.arange(300.0)
    return FinishedBlock(keys, result, 1.0, 2.0, "0")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    with Journal(folder) as journal:
        journal.remember({KERNELS: "abc", "other": "kept"})
        for number in range(BLOCKS):
            journal.commit(block(number))
        journal.note_shown()
    return folder


@pytest.fixture
def out(whole, tmp_path):
    return shutil.copytree(whole, tmp_path / "out")


def numbers(journal):
    """Blocks in a journal by their number, each held against what was written."""
    seen = []
    for stored in journal.blocks():
        number = int(stored.keys.tobytes()[6:11])
        assert (stored.result.outputs["y"].data == block(number).result.outputs["y"].data).all()
        assert stored.keys.tobytes() == block(number).keys.tobytes()
        seen.append(number)
    return seen


def change(out, edit):
    content = bytearray(journal_path(out).read_bytes())
    edit(content)
    journal_path(out).write_bytes(content)
    return content


def test_a_whole_journal_stays_as_it_is(out, capsys):
    ResultDirectory(out).close()
    with Journal(out) as journal:
        assert numbers(journal) == list(range(BLOCKS))
        assert journal.recall(SHOWN) == journal.state() == str(BLOCKS)
    assert capsys.readouterr().err == ""
    assert not list(out.glob("*damaged*"))


def test_a_journal_cut_to_99_percent_loses_the_last_block(out, capsys):
    """Regression: it was not readable, and nothing was kept."""
    change(out, lambda content: content.__delitem__(slice(len(content) * 99 // 100, None)))
    with pytest.raises(CubeError, match=r"the journal is damaged.*run the study again"):
        Journal(out, read_only=True).state()
    ResultDirectory(out).close()
    stated = capsys.readouterr().err
    with Journal(out) as journal:
        left = numbers(journal)
        assert journal.recall(SHOWN) is None
    assert left == list(range(len(left)))
    assert len(left) >= BLOCKS - 1
    assert f"{len(left)} blocks can be read, at least {BLOCKS - len(left)} cannot" in stated
    ResultDirectory(out).close()
    assert capsys.readouterr().err == ""  # stated once


@pytest.mark.parametrize("seed", range(10))
def test_a_cut_keeps_all_blocks_before_it(out, seed):
    at = random.Random(seed).randrange(10 * PAGE_BYTES, 80 * PAGE_BYTES)
    change(out, lambda content: content.__delitem__(slice(at, None)))
    with Journal(out) as journal:
        left = numbers(journal)
    assert left == list(range(len(left)))
    assert len(left) >= at // (2 * PAGE_BYTES) - 4  # a block has two pages


@pytest.mark.parametrize("page", first_fast(range(12), 5))
def test_a_lost_page_costs_the_blocks_on_it_whatever_it_holds(out, page):
    """The schema, the root of a table, the notes, leaves and long rows."""
    change(
        out, lambda content: content.__setitem__(slice(page * PAGE_BYTES, (page + 1) * PAGE_BYTES), bytes(PAGE_BYTES))
    )
    with Journal(out) as journal:
        assert journal.repaired
        assert len(numbers(journal)) >= BLOCKS - 2
        assert journal.recall(KERNELS) == "abc"
    Journal(out).close()


def is_read(out):
    """Whether a reader gets all that was written; else it is told of the damage."""
    try:
        with Journal(out, read_only=True) as journal:
            journal.check()
            assert journal.recall(SHOWN) == journal.state() == str(BLOCKS)
            assert numbers(journal) == list(range(BLOCKS))
    except CubeError as error:
        assert "damaged" in str(error)  # noqa: PT017
        return False
    return True


@pytest.mark.parametrize("seed", first_fast(range(40), 6))
def test_a_flipped_bit_costs_at_most_the_block_it_hits(out, seed):
    """A reader never gets a wrong number; a writer keeps all other blocks, and names the damaged file."""
    rng = random.Random(seed)
    at = rng.randrange(8 * journal_path(out).stat().st_size) if seed >= 10 else rng.randrange(8 * 100)  # the header
    content = change(out, lambda content: content.__setitem__(at // 8, content[at // 8] ^ (1 << at % 8)))
    harmless = is_read(out)
    with Journal(out) as journal:
        left = numbers(journal)
        assert len(left) >= BLOCKS - (not harmless)
        assert journal.recall(KERNELS) == "abc"
        assert (journal.repaired == "") == harmless
    if not harmless:
        assert (out / "journal.damaged.sqlite").read_bytes() == bytes(content)
        with Journal(out) as journal:
            assert journal.repaired == ""


@pytest.mark.parametrize("seed", first_fast(range(6), 2))
def test_blocks_behind_damage_in_the_log_of_a_killed_run_are_kept(whole, tmp_path, seed):
    """SQLite ends at the first damaged frame of its log, and does not say so."""
    out = shutil.copytree(whole, tmp_path / "out")
    journal = Journal(out)
    for number in range(BLOCKS, BLOCKS + 12):
        journal.commit(block(number))
    shutil.copytree(out, killed := tmp_path / "killed")
    journal.close()
    log = killed / "journal.sqlite-wal"
    content = bytearray(log.read_bytes())
    content[32 + random.Random(seed).randrange(8 * PAGE_BYTES)] ^= 8
    log.write_bytes(content)
    with Journal(killed) as journal:
        assert "the journal is damaged (its log hides" in journal.repaired
        left = numbers(journal)
    assert left[:BLOCKS] == list(range(BLOCKS))
    assert len(left) >= BLOCKS + 10


@pytest.mark.parametrize("size", [0, 10, 100_000])
def test_a_journal_of_which_nothing_is_left_is_refused(out, size):
    """Regression: of an empty one it was said that the disk is full."""
    journal_path(out).write_bytes(b"no journal" * (size // 10))
    with pytest.raises(CubeError, match="not a readable journal"):
        ResultDirectory(out)


def test_a_study_with_a_damaged_journal_runs_what_is_lost(tmp_path, capsys):
    """Regression: a traceback."""
    (tmp_path / "wide.py").write_text("import numpy as np\ndef f(x):\n    return {'y': np.full(3000, x)}\n")
    text = '[study]\nname="w"\nfunction="wide:f"\n[factors.x]\nlow=0\nhigh=1\ncount=20\n[run]\nblock=1\n'
    (tmp_path / "study.toml").write_text(text)
    td.run(tmp_path / "study.toml", tmp_path / "out", workers=0, progress=False)
    before = td.open_cube(tmp_path / "out")["y"]
    journal = tmp_path / "out" / "journal.sqlite"
    content = bytearray(journal.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 40_000] = bytes(40_000)
    journal.write_bytes(content)
    summary = td.run(tmp_path / "study.toml", tmp_path / "out", workers=0, progress=False)
    assert summary.good
    assert 0 < summary.computed < 6
    assert f"{20 - summary.computed} blocks can be read, at least {summary.computed} cannot" in capsys.readouterr().err
    assert (td.open_cube(tmp_path / "out")["y"] == before).all()


@pytest.mark.parametrize(
    "column", first_fast(["keys", "payload", "digest", "outcomes", "cpu_seconds", "worker", "kernels"], 3)
)
def test_a_value_of_another_kind_is_no_block(out, column):
    """As a damaged page may hold it: values of each type, none the column's own."""
    with closing(sqlite3.connect(journal_path(out))) as connection, connection:
        ((sql,),) = connection.execute("SELECT sql FROM sqlite_schema WHERE name = 'block'")
        connection.execute("PRAGMA writable_schema = ON")
        connection.execute("UPDATE sqlite_schema SET sql = replace(sql, ' NOT NULL', '') WHERE name = 'block'")
    for value in (None, 7, 0.5, "text", b"", b"PK"):
        with closing(sqlite3.connect(journal_path(out))) as connection, connection:
            connection.execute(f"UPDATE block SET {column} = ? WHERE id = 7", (value,))
        with closing(sqlite3.connect(journal_path(out))) as connection, connection:
            connection.execute("PRAGMA writable_schema = ON")
            connection.execute("UPDATE sqlite_schema SET sql = ? WHERE name = 'block'", (sql,))
        assert not is_read(out)
        with closing(sqlite3.connect(journal_path(out))) as connection, connection:
            connection.execute("PRAGMA writable_schema = ON")
            connection.execute("UPDATE sqlite_schema SET sql = replace(sql, ' NOT NULL', '') WHERE name = 'block'")
    with Journal(out) as journal:
        assert numbers(journal) == [number for number in range(BLOCKS) if number != 6]


ENDLESS = """
ALTER TABLE block RENAME TO kept;
CREATE VIEW block AS WITH RECURSIVE t(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM t) SELECT id, 0 AS digest,
    kept.keys, outcomes, cpu_seconds, wall_seconds, worker, kernels, payload_digest, payload FROM t, kept;
"""
TRIGGER = "CREATE TRIGGER more AFTER INSERT ON note BEGIN DELETE FROM block; END;"


@pytest.mark.parametrize("script", [ENDLESS, TRIGGER, "CREATE TABLE other (id INTEGER);"])
def test_a_journal_with_other_tables_is_refused_before_anything_in_it_runs(whole, tmp_path, script):
    """A view without an end would keep a reader, and a server of many results, for ever."""
    folder = tmp_path / "strange"
    shutil.copytree(whole, folder)
    with closing(sqlite3.connect(journal_path(folder))) as connection:
        connection.executescript(script)
    with pytest.raises(CubeError, match="tables are not the tables of a journal"):
        Journal(folder, read_only=True)
    with Journal(folder) as journal:  # a writer keeps what is whole
        assert "tables are not the tables of a journal" in journal.repaired
        assert len(list(journal.blocks())) == BLOCKS


@pytest.mark.parametrize(
    "strange",
    [
        "ALTER TABLE block RENAME TO hidden; CREATE VIEW block (id) AS WITH RECURSIVE t (id) AS "
        "(SELECT 1 UNION ALL SELECT id + 1 FROM t) SELECT id FROM t",
        "CREATE TRIGGER t AFTER INSERT ON block BEGIN DELETE FROM block; END",
        "CREATE TABLE other (id)",
    ],
)
def test_a_journal_with_views_or_triggers_is_not_read(out, strange):
    """Regression: a journal of a stranger whose table of blocks was an endless view was read without end."""
    with closing(sqlite3.connect(journal_path(out))) as connection:
        connection.executescript(strange)
    with pytest.raises(CubeError, match="its tables are not the tables of a journal"):
        Journal(out, read_only=True)
    with Journal(out) as journal:  # what is whole is kept, in tables of its own
        assert numbers(journal) == list(range(BLOCKS))


@pytest.mark.parametrize("key", first_fast([SHOWN, "repairs"], 1))
@pytest.mark.parametrize(
    "value", ["abc", "", "-5", "9" * 40, "9" * 5000, "\x1b[31mred", "[]", "1e400", "\N{SUPERSCRIPT TWO}"]
)
def test_a_note_that_must_be_a_number_and_is_none_costs_no_block(out, capsys, key, value):
    """Its checksum fits, as whoever can write a file can write its checksum: it ended in an internal error."""
    with Journal(out) as journal:
        journal.remember({key: value})
    assert "is no number" in damage(journal_path(out))
    with (
        pytest.raises(CubeError, match=r"the journal is damaged .*is no number"),
        Journal(out, read_only=True) as journal,
    ):
        journal.check()
    ResultDirectory(out).close()
    assert "60 blocks can be read" in capsys.readouterr().err
    with Journal(out) as journal:
        assert numbers(journal) == list(range(BLOCKS))
        assert journal.state() == str(BLOCKS)


def name_in_rollback_journal(path, victim):
    """Give an SQLite file the rollback journal of a transaction over several files: without pages, but with a name."""
    magic, name = bytes.fromhex("d9d505f920a163d7"), str(victim).encode()
    pages = path.stat().st_size // PAGE_BYTES
    head = (magic + struct.pack(">5I", 0, 1, pages, 512, PAGE_BYTES)).ljust(PAGE_BYTES, b"\0")
    tail = struct.pack(">I", 2**30 // PAGE_BYTES + 1) + name + struct.pack(">2I", len(name), sum(name)) + magic
    path.with_name(f"{path.name}-journal").write_bytes(head + tail)


@pytest.mark.parametrize("name", ["-wal", "-shm", "-journal"])
def test_a_link_to_no_journal_deletes_nothing_beside_its_target(out, tmp_path, capsys, name):
    """Regression: SQLite took the files beside for what an interrupted transaction had left, and deleted them."""
    target, beside = tmp_path / "letter", tmp_path / f"letter{name}"
    target.write_text("to a friend")
    beside.write_bytes(b"mine")
    journal_path(out).unlink()
    journal_path(out).symlink_to(target)
    for words in (["query", str(out), "--variable", "y"], ["check", str(out)], ["derive", str(out), "--variable", "y"]):
        main(words)
        assert beside.read_bytes() == b"mine"
    assert "a link to a file that is no journal" in capsys.readouterr().err


def test_a_journal_that_names_another_file_deletes_none(out, tmp_path):
    """Security: SQLite deletes the file that a rollback journal of several files names, wherever it is."""
    victim = tmp_path / "victim"
    victim.touch()
    name_in_rollback_journal(journal_path(out), victim)
    with pytest.raises(CubeError, match=r"names another file, which SQLite would delete"):
        Journal(out, read_only=True)
    assert victim.exists()
    with Journal(out) as journal:  # a writer keeps what is whole
        assert numbers(journal) == list(range(BLOCKS))
    assert victim.exists()


@pytest.mark.parametrize(
    "payload", [b"abc", struct.pack("<Q", 200_008) + b'{"a":' + 100_000 * b"[" + 100_000 * b"]" + b"}  "]
)
def test_results_that_another_program_wrote_are_named_by_every_reader(out, payload):
    """Checksums that fit say nothing about what another program wrote: `check` called it whole, `query` was a traceback."""
    with closing(sqlite3.connect(journal_path(out))) as connection:
        row = BlockRow(*connection.execute(f"SELECT {', '.join(BLOCK_COLUMNS)} FROM block WHERE id = 1").fetchone())
        row = replace(row, payload=payload, payload_digest=zlib.crc32(payload)).numbered(1)
        edited = "UPDATE block SET digest = ?, payload_digest = ?, payload = ? WHERE id = 1"
        connection.execute(edited, (row.digest, row.payload_digest, row.payload))
        connection.commit()
    with Journal(out) as journal, pytest.raises(CubeError, match="block 1: its results cannot be read"):
        list(journal.blocks())
    assert damage(journal_path(out)).startswith("block 1: its results cannot be read")


def test_more_texts_than_points_are_no_results(out):
    """Three million texts of one point took 22 s."""
    result = block(0).result
    payload = encode(replace(result, detail=["a", "b", *result.detail[2:]]))
    with pytest.raises(ValueError, match="texts of 1 points"):
        decode(payload, result.outcome[:1])


def test_a_reader_that_ends_after_the_journal_says_nothing(out, capsys):
    with Journal(out) as journal:
        blocks = journal.blocks()
        next(blocks)
    with warnings.catch_warnings(record=True) as caught:
        del blocks
        gc.collect()
    assert not caught
    assert capsys.readouterr().err == ""
