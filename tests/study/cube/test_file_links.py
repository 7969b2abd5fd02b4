"""Exact: a netCDF file that takes values from other files is refused before netCDF4 opens it."""

from __future__ import annotations

import ctypes
import os
import shutil
import struct
import tracemalloc
from pathlib import Path

import h5py
import netCDF4
import numpy as np
import pytest
import xarray as xr

import tripod_doe as td
from tripod_doe.cli import main
from tripod_doe.errors import CubeError, InputError
from tripod_doe.model_interface import OUTCOME_ATTRIBUTES
from tripod_doe.study.cube.file_links import refuse_outside
from tripod_doe.study.cube.netcdf import dataset_of, opened_file, write_dataset
from tripod_doe.study.result_directory.directory import make_directory
from tripod_doe.study.result_directory.open_cube import opened_cube

pytestmark = pytest.mark.usefixtures("pages_not_made")

SECRET = b"the token of the owner"
ID = ctypes.c_int64
LIBRARY = ctypes.CDLL(netCDF4._netCDF4.__file__)


def hdf5(name, *arguments, result=ID):
    """Call a function of HDF5; whole numbers are identifiers."""
    function = getattr(LIBRARY, name)
    function.restype, function.argtypes = result, None
    value = function(*(ID(each) if isinstance(each, int) else each for each in arguments))
    assert ctypes.c_int(value).value >= 0, name  # also of a function that gives a C int
    return value


def constant(name):
    return ID.in_dll(LIBRARY, name).value


def external_storage(file, secret):
    sizes = (ctypes.c_uint64 * 1)(len(SECRET))
    space = hdf5("H5Screate_simple", 1, sizes, None)
    created = hdf5("H5Pcreate", constant("H5P_CLS_DATASET_CREATE_ID_g"))
    hdf5("H5Pset_external", created, secret, 0, ctypes.c_uint64(len(SECRET)))
    hdf5("H5Dclose", hdf5("H5Dcreate2", file, b"stolen", constant("H5T_NATIVE_UINT8_g"), space, 0, created, 0))


def virtual(file, secret):
    sizes = (ctypes.c_uint64 * 1)(4)
    space = hdf5("H5Screate_simple", 1, sizes, None)
    created = hdf5("H5Pcreate", constant("H5P_CLS_DATASET_CREATE_ID_g"))
    hdf5("H5Pset_virtual", created, space, secret, b"/data", space)
    hdf5("H5Dclose", hdf5("H5Dcreate2", file, b"stolen", constant("H5T_NATIVE_UINT8_g"), space, 0, created, 0))


def external_link(file, secret):
    hdf5("H5Lcreate_external", secret, b"/data", file, b"stolen", 0, 0)


def in_a_group(file, secret):
    group = hdf5("H5Gcreate2", file, b"inner", 0, 0, 0)
    external_storage(group, secret)
    hdf5("H5Gclose", group)


def circle(file, _):
    group = hdf5("H5Gcreate2", file, b"inner", 0, 0, 0)
    hdf5("H5Lcreate_hard", file, b"/inner", group, b"again", 0, 0)
    hdf5("H5Gclose", group)


def circle_to_the_top(file, _):
    group = hdf5("H5Gcreate2", file, b"inner", 0, 0, 0)
    hdf5("H5Lcreate_hard", file, b"/", group, b"again", 0, 0)
    hdf5("H5Gclose", group)


def symbolic_circle(file, _):
    group = hdf5("H5Gcreate2", file, b"inner", 0, 0, 0)
    hdf5("H5Lcreate_soft", b"/inner", group, b"again", 0, 0)
    hdf5("H5Gclose", group)


def written(path):
    dataset = xr.Dataset({"y": ("x", np.arange(40.0)), "word": ("x", np.array(["text"] * 40, object))})
    write_dataset(dataset.assign_coords(x=np.arange(40.0)), path)
    return path


@pytest.fixture
def secret(tmp_path):
    file = tmp_path / "secret"
    file.write_bytes(SECRET)
    return file


def hostile(tmp_path, make, target):
    """A netCDF file to which another program added something that leads to another file."""
    path = tmp_path / "cube.nc"
    with netCDF4.Dataset(path, "w") as stored:
        stored.createDimension("x", 3)
        stored.createVariable("y", "f8", ("x",))[:] = 1.0
    file = hdf5("H5Fopen", os.fsencode(path), ctypes.c_uint(1), 0)
    make(file, os.fsencode(target))
    hdf5("H5Fclose", file)
    return path


def by_query(path):
    with opened_cube(path) as cube:
        return cube.variables


def by_file(path):
    with opened_file(path) as stored:
        return stored.variables


@pytest.mark.parametrize("make", [external_storage, virtual, external_link, in_a_group])
@pytest.mark.parametrize("read", [td.open_cube, by_query, by_file])
def test_a_file_that_leads_to_another_is_refused(tmp_path, secret, make, read):
    path = hostile(tmp_path, make, secret)
    with pytest.raises(td.CubeError, match=r"(?:stolen|inner).*another file"):
        read(path)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (circle, "'inner/again' is a second name of 'inner'"),
        (circle_to_the_top, "'inner/again' is a second name of '/'"),
        (symbolic_circle, "'inner/again' is a symbolic link"),
    ],
)
@pytest.mark.parametrize("read", [td.open_cube, by_query, by_file])
def test_groups_in_a_circle_are_refused(tmp_path, make, message, read):
    """Regression: netCDF4 followed them without an end, and Ctrl-C did not stop it."""
    with pytest.raises(td.CubeError, match=message):
        read(hostile(tmp_path, make, "nowhere"))


@pytest.mark.parametrize("make", [external_storage, virtual, external_link])
def test_a_pipe_is_not_waited_for(tmp_path, make):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(td.CubeError, match="another file"):
        td.open_cube(hostile(tmp_path, make, tmp_path / "pipe"))


def test_a_file_of_its_own_is_read_also_while_it_is_open(tmp_path):
    path = written(tmp_path / "cube.nc")
    with opened_file(path), netCDF4.Dataset(path) as stored:
        for _ in range(3):
            refuse_outside(path)
        assert stored["y"][:].tolist() == list(range(40))
    assert set(td.open_cube(path)["word"].values) == {"text"}


@pytest.mark.parametrize("read", [td.open_cube, by_query, by_file])
@pytest.mark.parametrize("inside", ["", "inner"])
def test_a_file_that_announces_more_than_it_can_hold_is_refused(tmp_path, read, inside):
    """A chunk that was never written costs no byte: 20 kB announced a terabyte, and a query read it all."""
    path = tmp_path / "cube.nc"
    with netCDF4.Dataset(path, "w") as stored:
        group = stored.createGroup(inside) if inside else stored
        for name in ("x", "z"):
            group.createDimension(name, 1_000_000)
        group.createVariable("y", "f8", ("x", "z"), zlib=True, chunksizes=(1000, 1000))[0, 0] = 1.0
    with pytest.raises(CubeError, match=r"announces 8 TB of values in a file of .* kB"):
        read(path)


def sparse_cube(path, points):
    """A cube of which hardly any value was written."""
    with netCDF4.Dataset(path, "w") as stored:
        stored.createDimension("point", points)
        stored.createDimension("order", 100)
        stored.createVariable("order", "i4", ("order",))[:] = np.arange(100)
        outcome = stored.createVariable("outcome", "i1", ("point",), zlib=True)
        outcome.setncatts(OUTCOME_ATTRIBUTES)
        outcome[:] = 0
        force = stored.createVariable("force", "f8", ("point", "order"), chunksizes=(1000, 100), fill_value=np.nan)
        force[0] = np.arange(100.0)
    return path


@pytest.mark.parametrize(
    "ask",
    [
        lambda path: td.open_cube(path),
        lambda path: main(["query", str(path), "--variable", "force"]),
        lambda path: td.query(path, "force"),
    ],
)
def test_what_does_not_fit_into_memory_is_refused_before_it_is_read(tmp_path, monkeypatch, ask, capsys):
    """Regression: a file of 18 kB that announced 8 GB took all of the memory; a part of it is read as before."""
    path = sparse_cube(tmp_path / "cube.nc", 200_000)
    monkeypatch.setattr("tripod_doe.study.memory._free_memory", lambda: 140_000_000)
    assert td.query(path, "force", {"order": 3})["force"].shape == (200_000, 1)
    tracemalloc.start()
    try:
        with pytest.raises((InputError, SystemExit)) as refused:
            raise SystemExit(ask(path))
        assert "needs about" in str(refused.value) + capsys.readouterr().err
        assert tracemalloc.get_traced_memory()[1] < 20_000_000
    finally:
        tracemalloc.stop()


def test_more_points_than_memory_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("tripod_doe.study.memory._free_memory", lambda: 1_000_000)
    with pytest.raises(InputError, match=r"a list of 100,000 points needs about 1.6 MB of memory"):
        td.open_cube(sparse_cube(tmp_path / "cube.nc", 100_000), chunks="auto")


@pytest.mark.slow
def test_values_that_pack_well_are_read(tmp_path):
    path = tmp_path / "cube.nc"
    with netCDF4.Dataset(path, "w") as stored:
        stored.createDimension("x", 20_000_000)
        stored.createVariable("y", "f8", ("x",), zlib=True, complevel=9, chunksizes=(1_000_000,))[:] = 0.0
    with opened_file(path) as read:
        assert path.stat().st_size < 1_000_000
        assert read["y"].shape == (20_000_000,)


def test_files_without_hdf5_are_read(tmp_path):
    path = tmp_path / "classic.nc"
    with netCDF4.Dataset(path, "w", format="NETCDF3_CLASSIC") as stored:
        stored.createDimension("x", 3)
        stored.createVariable("y", "f8", ("x",))[:] = 1.0
    assert td.open_cube(path)["y"].sum() == 3.0


def test_a_variable_that_is_packed_by_a_text_is_refused(tmp_path):
    """Regression: every reader of such a file ended in an internal error."""
    with netCDF4.Dataset(tmp_path / "a.nc", "w") as stored:
        stored.createDimension("x", 3)
        stored.createVariable("y", "f8", ("x",))[:] = 1.0
        stored["y"].add_offset = "true"
    with pytest.raises(CubeError, match="y is packed by a text in place of a number"):
        td.open_cube(tmp_path / "a.nc")


@pytest.mark.slow
def test_a_chunk_that_fills_the_memory_is_refused(tmp_path):
    """Regression: one value of a chunk of 4 GB, 62 kB in its file, took 4 GB of memory."""
    with netCDF4.Dataset(tmp_path / "a.nc", "w") as stored:
        stored.createDimension("point", None)
        thrust = stored.createVariable("thrust", "f8", ("point",), zlib=True, chunksizes=(20_000_000,))
        thrust[:4] = 1.0
    with pytest.raises(CubeError, match=r"has a chunk of 160 MB"):
        dataset_of(tmp_path / "a.nc")


@pytest.mark.slow
def test_texts_that_share_their_letters_are_refused(tmp_path):
    """Regression: 20,000 texts of a file of 2.5 MB named one text of 1 MB, and took 20 GB of memory."""
    path = tmp_path / "a.nc"
    with netCDF4.Dataset(path, "w") as stored:
        stored.createDimension("point", 1500)
        texts = stored.createVariable("model", str, ("point",))
        texts[:] = np.array(["a" * 1_000_000] + ["b"] * 1499, object)
    dataset_of(path).close()
    content = bytearray(path.read_bytes())
    first = content.index(struct.pack("<I", 1_000_000))  # the reference: length, place of the heap, number in it
    content[first + 16 : first + 16 * 1500] = content[first : first + 16] * 1499
    path.write_bytes(content)
    with pytest.raises(CubeError, match="more text than fits"):
        dataset_of(path)


@pytest.mark.parametrize("read", [td.open_cube, by_query, by_file, dataset_of])
def test_the_file_of_the_name_is_the_one_that_is_read(tmp_path, monkeypatch, secret, read):
    r"""Regression: netCDF drops white space at the front and takes a \ for a /, so it read a file that was not checked."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a\\b").mkdir()
    (tmp_path / "a").mkdir()
    written(tmp_path / "good.nc")
    hostile(tmp_path, external_link, secret).rename(tmp_path / "a" / "b")
    shutil.copy(tmp_path / "good.nc", tmp_path / " a.nc")
    shutil.copy(tmp_path / "a" / "b", tmp_path / "a.nc")
    assert set(by_file(Path(" a.nc"))) == {"x", "y", "word"}
    dataset_of(" a.nc").close()
    shutil.copy(tmp_path / "good.nc", tmp_path / "a\\b" / "cube.nc")
    with pytest.raises(CubeError, match="which netCDF takes for a /"):
        read(Path("a\\b/cube.nc"))


def test_results_are_kept_where_netcdf_finds_them(tmp_path, monkeypatch):
    r"""Regression: after all points of a run, its cube could not be written: "Permission denied; free space"."""
    monkeypatch.chdir(tmp_path)
    write_dataset(xr.Dataset({"y": ("x", [1.0])}), Path(" a") / "b.nc")
    assert os.listdir(tmp_path / " a") == ["b.nc"]
    for write in (make_directory, lambda path: write_dataset(xr.Dataset(), path)):
        with pytest.raises(InputError, match="which netCDF takes for a /"):
            write(Path("a\\b"))


@pytest.mark.slow
def test_many_groups_are_refused(tmp_path):
    """Regression: netCDF ended the process at a file of 7 MB with 50,000 groups."""
    with h5py.File(tmp_path / "a.nc", "w", libver="latest") as file:
        for name in range(5001):
            file.create_group(str(name))
    with pytest.raises(CubeError, match="more than 5,000 variables"):
        dataset_of(tmp_path / "a.nc")


@pytest.mark.parametrize("kind", ["f2", "g"])
def test_floats_that_end_the_process_in_netcdf_are_refused(tmp_path, kind):
    """Regression: a cube with half or extended precision ended the process by a signal."""
    for name, content in (("values", np.zeros(3, kind)), ("type", np.dtype(kind))):
        with h5py.File(tmp_path / f"{name}.nc", "w") as file:
            file["x"] = content
        with pytest.raises(CubeError, match="neither 4 nor 8 bytes"):
            td.open_cube(tmp_path / f"{name}.nc")
