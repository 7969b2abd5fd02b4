"""Files of a stranger's results: pipes, devices, links and sparse files are refused where they would be read."""

from __future__ import annotations

import errno
import os
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from tripod_doe.errors import InputError
from tripod_doe.files.checksum_list import write_listed
from tripod_doe.files.regular_files import open_locked, read_regular
from tripod_doe.measurements.record_file import read_record
from tripod_doe.notification import Notifier
from tripod_doe.service.runs.processes import is_held, run_log, run_process, start_run
from tripod_doe.service.runs.run_table import TABLE, RunTable
from tripod_doe.service.server import _locked_folder
from tripod_doe.service.settings import Settings, read_token
from tripod_doe.study.execution.dask_existing_scheduler import ExistingScheduler, tls_files


def test_files_up_to_a_size_are_read_and_links_only_where_the_user_names_them(tmp_path):
    path, link = tmp_path / "file", tmp_path / "link"
    path.write_bytes(b"12345")
    link.symlink_to(path)
    assert read_regular(path, 5) == read_regular(link, 5, links=True) == b"12345"
    with pytest.raises(InputError, match="5 bytes, at most 4 are read"):
        read_regular(path, 4)
    with pytest.raises(InputError, match="a link, but a file is needed"):
        read_regular(link)
    with pytest.raises(FileNotFoundError):
        read_regular(tmp_path / "none")
    with pytest.raises(InputError, match="more than 10 bytes"):  # its size is 0
        read_regular(Path("/proc/self/maps"), 10)


def test_a_pipe_of_the_shell_is_read():
    """As in ``tripod-doe run <(generate)``."""
    reader, writer = os.pipe()
    os.write(writer, b"text")
    os.close(writer)
    assert read_regular(Path(f"/dev/fd/{reader}")) == b"text"
    os.close(reader)


def test_what_is_locked_is_a_file_under_one_name(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").touch()
    os.link(tmp_path / "file", tmp_path / "other")
    (tmp_path / "link").symlink_to("file")
    for name, flags in (("pipe", os.O_RDONLY), ("link", os.O_RDONLY), ("file", os.O_CREAT | os.O_RDWR)):
        with pytest.raises(OSError, match="link") as refused:
            open_locked(tmp_path / name, flags)
        assert refused.value.errno == errno.ELOOP, name
    os.close(open_locked(tmp_path / "file"))  # the lock of a copy by hard links


@pytest.mark.parametrize("name", [".lock", ".alive", "run.log"])
def test_a_pipe_in_a_found_directory_does_not_block_the_supervisor(tmp_path, name):
    """Regression: no run started any more, and the server could not be ended."""
    os.mkfifo(tmp_path / name)
    assert not is_held(tmp_path)
    assert run_process(tmp_path) is None
    assert run_log(tmp_path) == ""
    if name != ".lock":
        with pytest.raises(InputError, match="cannot"):
            start_run(tmp_path, [], 10**10)


@pytest.mark.parametrize("name", [TABLE, f"{TABLE}-journal", f"{TABLE}-wal", ".service.lock"])
def test_a_pipe_in_place_of_the_table_of_runs_is_refused(tmp_path, name):
    """Regression: the server waited for a writer before it listened."""
    os.mkfifo(tmp_path / name)
    with pytest.raises(InputError), _locked_folder(Settings(tmp_path)):
        pass
    if name != ".service.lock":
        with pytest.raises(InputError, match="a pipe"):
            RunTable(tmp_path)


@pytest.mark.parametrize("read_only", [False, True])
@pytest.mark.parametrize(
    "program",
    [
        "CREATE VIEW run AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n) "
        "SELECT id, id AS key, id AS record, id AS number FROM n",
        "CREATE TABLE run (number, id, key, record); CREATE TRIGGER more AFTER INSERT ON run BEGIN DELETE FROM run; END",
    ],
)
def test_a_table_of_runs_with_programs_is_refused(tmp_path, read_only, program):
    """Regression: a view without end in the folder of a stranger held up the server for ever."""
    with closing(sqlite3.connect(tmp_path / TABLE)) as connection:
        connection.executescript(program)
    with pytest.raises(InputError, match="it has views or triggers"):
        RunTable(tmp_path, read_only)


@pytest.mark.parametrize(
    "read",
    [
        read_token,
        lambda pipe: Notifier.of(f"@{pipe}"),
        lambda pipe: ExistingScheduler(file=pipe)._read_address(),
        lambda pipe: tls_files(pipe, pipe, pipe).security(),
    ],
)
def test_a_pipe_that_an_option_names_is_refused(tmp_path, read):
    """Regression: `--token-file`, `--notify @FILE`, `--scheduler-file` and `--tls-key` waited for a writer."""
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="a pipe, but a file is needed"):
        read(tmp_path / "pipe")


def test_a_sparse_record_is_refused_by_its_size(tmp_path):
    path = tmp_path / "record.csv"
    path.touch()
    os.truncate(path, 60_000_000_000)
    with pytest.raises(InputError, match="60,000,000,000 bytes, at most"):
        read_record(path)


def test_a_planted_list_leads_to_no_other_file(tmp_path):
    """Regression: a name in the upcoming list was read through a link, such as to the memory of this process."""
    (tmp_path / "x").symlink_to("/proc/self/mem")
    (tmp_path / ".checksums.sha256.next").write_text(f"{'0' * 64}  x\n")
    assert write_listed(tmp_path / "page.html", "text").read_text() == "text"
