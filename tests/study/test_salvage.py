"""Damaged journals: what can be read is kept, what is lost is reported and computed again, and no wrong number is read."""

from __future__ import annotations

import random
import shutil
from contextlib import closing, suppress
from pathlib import Path

import numpy as np
import pytest

import tripod_doe as td
from tripod_doe.errors import CubeError
from tripod_doe.simulator import BlockResult, Outcome
from tripod_doe.study.archive import Archive, is_whole, write_archive
from tripod_doe.study.block_record import encode
from tripod_doe.study.directory import ResultDirectory
from tripod_doe.study.journal import FinishedBlock, Journal

pytestmark = pytest.mark.usefixtures("pages_not_made")

BLOCKS = 60
EARLIER = Path(__file__).parent / "earlier_journal"


def block(number):
    """Two points whose output follows from their fingerprints."""
    keys = np.frombuffer(b"".join(f"point {number:5} {row:4}".encode() for row in range(2)), "V16")
    result = BlockResult.blank(2, Outcome.FINISHED)
    result.put("y", ("place",), slice(None), number + np.arange(2.0)[:, None] + np.arange(300.0))
    result.coordinates["place"] = np.arange(300.0)
    return FinishedBlock(keys, result, 1.0, 2.0, "0")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    with Journal(folder) as journal:
        journal.remember({"kernels": "abc"})
        for number in range(BLOCKS):
            journal.commit(block(number))
        journal.note_shown()
    return folder


def numbers(folder):
    """Blocks in a journal by their number, each held against what was written."""
    found = []
    with Journal(folder) as journal:
        for stored in journal.blocks():
            number = int(stored.keys.tobytes()[6:11])
            assert (stored.result.outputs["y"].data == block(number).result.outputs["y"].data).all()
            assert stored.keys.tobytes() == block(number).keys.tobytes()
            found.append(number)
        assert journal.recall("kernels") in ("abc", None)  # a page of its own
    return found


def test_a_whole_journal_stays_as_it_is(whole, tmp_path, capsys):
    shutil.copytree(whole, tmp_path / "out")
    ResultDirectory(tmp_path / "out").close()
    assert numbers(tmp_path / "out") == list(range(BLOCKS))
    assert capsys.readouterr().err == ""
    assert not list((tmp_path / "out").glob("*damaged*"))


@pytest.mark.parametrize("seed", range(40))
def test_damage_anywhere_costs_the_blocks_that_it_hits(whole, tmp_path, capsys, seed):
    """A byte, a page or a stretch, at random places; page 1 holds the schema, without which nothing can be read."""
    rng, out = random.Random(seed), tmp_path / "out"
    shutil.copytree(whole, out)
    content = bytearray((out / "journal.sqlite").read_bytes())
    length = (1, 4096, 20_000)[seed % 3]
    start = rng.randrange(0 if seed % 10 == 0 else 4096, len(content) - length)
    content[start : start + length] = rng.randbytes(length)
    (out / "journal.sqlite").write_bytes(content)
    if start < 4096:
        with suppress(CubeError):  # page 1 tells where all others belong
            ResultDirectory(out).close()
        return
    ResultDirectory(out).close()
    told = capsys.readouterr().err
    left = numbers(out)
    assert left == sorted(set(left))
    assert len(left) >= BLOCKS - 8 - length // 1000
    if len(left) < BLOCKS:
        assert f"the journal is damaged: {len(left)} blocks can be read" in told
        assert (out / "journal.damaged.sqlite").read_bytes() == bytes(content)


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
    content[middle : middle + 20_000] = bytes(20_000)
    journal.write_bytes(content)
    summary = td.run(tmp_path / "study.toml", tmp_path / "out", workers=0, progress=False)
    assert summary.good
    assert 0 < summary.computed < 6
    assert f"{20 - summary.computed} blocks can be read, at least {summary.computed} cannot" in capsys.readouterr().err
    assert (td.open_cube(tmp_path / "out")["y"] == before).all()


@pytest.fixture(params=["record", "npz archive of an earlier version"])
def row(request, whole, tmp_path):
    """A block as an archive stores it."""
    if request.param != "record":  # a copy: SQLite writes beside what it reads
        whole = shutil.copytree(EARLIER, tmp_path / "earlier")
    with closing(Archive(whole / "journal.sqlite")) as archive:
        return next(archive.rows())


def read(rows, folder):
    """What a journal reads of stored blocks, each as bytes."""
    write_archive(folder / "again.sqlite", rows, {})
    with closing(Archive(folder / "again.sqlite")) as archive:
        return [encode(block, 0) for block in archive.blocks()]


def test_a_block_that_counts_as_whole_is_read_as_it_was_written(row, tmp_path):
    """Damage of each byte, in turn by one bit or all others; what no checksum holds is a date of a zip archive."""
    keys, payload, *others = row
    rows = [row]
    for place in range(len(payload)):
        damaged = bytearray(payload)
        damaged[place] ^= 8 if place % 2 else 247  # bit 3 alone names another compression
        rows.append((keys, bytes(damaged), *others))
    whole = [row for row in rows if is_whole(*row)]
    assert whole[0] is row
    assert len(whole) < len(rows) / 2
    assert set(read(whole, tmp_path)) == set(read([row], tmp_path))


def test_a_block_with_a_column_of_another_kind_is_not_whole(row):
    """As a damaged page of SQLite gives it: each column has a value of each kind that is not its own."""
    for column in range(len(row)):
        for strange in (None, 7, 0.5, "text", b"", b"PK", row[0][::-1], row[1][:-9]):
            if type(strange) is not type(row[column]) or column < 2:
                assert not is_whole(*row[:column], strange, *row[column + 1 :]), (column, strange)
