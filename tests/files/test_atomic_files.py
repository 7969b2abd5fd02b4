"""Files replaced as a whole: the old one or the new one, never half of one."""

from __future__ import annotations

import errno
import os
import resource

import numpy as np
import pytest
import xarray as xr

import tripod_doe as td
from tripod_doe.files.atomic_files import replace_file, replace_text
from tripod_doe.study.cube.netcdf import write_dataset


def test_a_text_takes_the_place_of_the_old_one(tmp_path):
    path = tmp_path / "new folder" / "file.txt"
    replace_text(path, "one\n")
    assert replace_text(path, "zwei ö\n").read_text(encoding="utf-8") == "zwei ö\n"
    assert [entry.name for entry in path.parent.iterdir()] == ["file.txt"]


def test_the_old_file_stays_until_the_new_one_is_whole(tmp_path):
    path = replace_text(tmp_path / "file.txt", "old")

    def fill_the_disk():
        with replace_file(path) as fresh:
            fresh.write_text("half of the n")
            assert path.read_text() == "old"
            raise OSError(28, "No space left on device")

    with pytest.raises(td.StorageError, match=r"file\.txt: cannot write this file: No space left.*: free space"):
        fill_the_disk()
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["file.txt"]  # what was written does not fill the disk


def test_a_full_disk_is_named_where_netcdf_names_no_reason(tmp_path):
    """Regression: "cannot write this file: NetCDF: HDF error"."""
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, usual[1]))  # of a file, as a full disk
    try:
        with pytest.raises(td.StorageError, match=r"cube\.nc: cannot write this file: File too large"):
            write_dataset(xr.Dataset({"a": ("x", np.random.default_rng(0).random(400_000))}), tmp_path / "cube.nc")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)
    assert not list(tmp_path.iterdir())


def test_a_full_disk_is_named_where_netcdf_speaks_of_a_permission(tmp_path):
    """Regression: "Permission denied", as it says where the disk takes not even the first bytes."""
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, usual[1]))
    try:
        with pytest.raises(td.StorageError, match="File too large"), replace_file(tmp_path / "cube.nc"):
            raise PermissionError(errno.EACCES, "Permission denied")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)


def test_a_file_that_cannot_be_made_is_an_error(tmp_path):
    """Regression: the remedy was to free space."""
    (tmp_path / "file").write_text("")
    with pytest.raises(td.StorageError, match="File exists; nothing that was finished is lost: mend this, then run"):
        replace_text(tmp_path / "file" / "below.txt", "text")


def test_a_link_that_was_planted_where_a_file_is_written_is_not_followed(tmp_path):
    """Regression: a link under the name of the new file overwrote another file of the owner."""
    precious = tmp_path / "precious"
    precious.write_text("precious")
    (tmp_path / ".file.txt.new").symlink_to(precious)
    path = replace_text(tmp_path / "file.txt", "text")
    assert precious.read_text() == "precious"
    assert path.read_text() == "text"
    assert not path.is_symlink()


def test_a_device_or_pipe_is_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(td.StorageError, match="something other than a file has this name"):
        replace_text(tmp_path / "pipe", "text")
    assert (tmp_path / "pipe").is_fifo()
