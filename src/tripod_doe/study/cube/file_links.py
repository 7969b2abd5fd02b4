"""Refusal of netCDF files with links or storage outside the file or in a circle, which HDF5 and netCDF4 would follow.

HDF5 reads values from any file that an external link, a list of external files or a virtual data set names. So a
stranger's cube could read other files of its user. Groups that contain themselves are followed endlessly. All links are
checked, without following any, before netCDF4 opens the file. Our files have one name for each object.
"""

import ctypes
import os
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from tripod_doe.errors import CubeError
from tripod_doe.study.cube.netcdf_lock import NETCDF_LOCK

_CLASSIC = (b"CDF\x01", b"CDF\x02", b"CDF\x05")  # netCDF files without HDF5, which hold no links
_HARD, _SOFT = 0, 1  # kinds of links that stay in the file
_DATASET = 5
_VIRTUAL = 3
_BY_NAME, _AS_STORED = 0, 2  # the order of links
_BASIC = 1  # facts of an object, its token among them
_MOST_LINKS, _DEEPEST = 100_000, 30


class _ObjectInfo(ctypes.Structure):
    """The requested part of `H5O_info2_t`; the token identifies the object."""

    _fields_ = (("file", ctypes.c_ulong), ("token", ctypes.c_uint64 * 2), ("rest", ctypes.c_uint64 * 8))


class _LinkInfo(ctypes.Structure):
    """`H5L_info2_t`; of a hard link, the last part identifies the object."""

    _fields_ = (
        ("type", ctypes.c_int),
        ("order_valid", ctypes.c_bool),
        ("order", ctypes.c_int64),
        ("charset", ctypes.c_int),
        ("target", ctypes.c_uint64 * 2),
    )


_VISIT = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int64, ctypes.c_char_p, ctypes.POINTER(_LinkInfo), ctypes.c_void_p)
_ID, _PLACE = ctypes.c_int64, ctypes.c_void_p
_SIGNATURES: dict[str, tuple[Any, ...]] = {  # result and arguments
    "H5open": (ctypes.c_int,),
    "H5Eset_auto2": (ctypes.c_int, _ID, _PLACE, _PLACE),
    "H5Pcreate": (_ID, _ID),
    "H5Pclose": (ctypes.c_int, _ID),
    "H5Pset_fapl_stdio": (ctypes.c_int, _ID),
    "H5Pset_file_locking": (ctypes.c_int, _ID, ctypes.c_bool, ctypes.c_bool),
    "H5Pget_layout": (ctypes.c_int, _ID),
    "H5Pget_external_count": (ctypes.c_int, _ID),
    "H5Fopen": (_ID, ctypes.c_char_p, ctypes.c_uint, _ID),
    "H5Fclose": (ctypes.c_int, _ID),
    "H5Lvisit2": (ctypes.c_int, _ID, ctypes.c_int, ctypes.c_int, _VISIT, _PLACE),
    "H5Oopen": (_ID, _ID, ctypes.c_char_p, _ID),
    "H5Oclose": (ctypes.c_int, _ID),
    "H5Oget_info3": (ctypes.c_int, _ID, ctypes.POINTER(_ObjectInfo), ctypes.c_uint),
    "H5Iget_type": (ctypes.c_int, _ID),
    "H5Dget_create_plist": (_ID, _ID),
}


@cache
def hdf5_library() -> ctypes.CDLL:
    """Give the HDF5 library that netCDF4 itself has loaded.

    Raises:
        CubeError: If its functions cannot be reached: no file is then read unchecked.
    """
    from netCDF4 import _netCDF4

    try:
        library = ctypes.CDLL(_netCDF4.__file__)  # finds functions of the libraries that it was linked with, too
        for name, (result, *arguments) in _SIGNATURES.items():
            function = getattr(library, name)
            function.restype, function.argtypes = result, arguments
    except (OSError, AttributeError) as error:
        raise CubeError(
            f"the HDF5 library of netCDF4 cannot be asked for the links of a file ({error}), and no file is read "
            "without that: install netCDF4 from PyPI, or one with HDF5 1.14 or later"
        ) from error
    library.H5open()
    library.H5Eset_auto2(0, None, None)  # as netCDF4 does: errors are raised here, not printed
    return library


class _Found(NamedTuple):
    """Targets of the links of a file: objects by their identity, and reasons to refuse it."""

    objects: dict[tuple[int, int], bytes]
    reasons: list[str]


def refuse_outside(path: str | Path) -> None:
    """Refuse a netCDF file that takes values from other files or has links, without following one of those.

    Raises:
        CubeError: With the name of the variable or link.
        OSError: If it is no netCDF file, or damaged.
    """
    with open(path, "rb") as stream:
        if stream.read(4) in _CLASSIC:
            return
    with NETCDF_LOCK:
        library = hdf5_library()
        file = _opened(library, path)
        try:
            links = _links(library, file)
        finally:
            library.H5Fclose(file)
    if links.reasons:
        raise CubeError(f"{path}: {links.reasons[0]}; it is not read")


def _opened(library: ctypes.CDLL, path: str | Path) -> int:
    """Open the file on its own, also where netCDF4 has it open: with another driver, HDF5 does not share it."""
    access = library.H5Pcreate(ctypes.c_int64.in_dll(library, "H5P_CLS_FILE_ACCESS_ID_g"))
    try:
        library.H5Pset_fapl_stdio(access)
        library.H5Pset_file_locking(access, False, True)
        file = int(library.H5Fopen(os.fsencode(path), 0, access))
    finally:
        library.H5Pclose(access)
    if file < 0:
        raise OSError(f"{path}: HDF5 cannot read it")
    return file


def _links(library: ctypes.CDLL, file: int) -> _Found:
    """Check all links of a file, and each object that they lead to."""
    root = _ObjectInfo()
    if library.H5Oget_info3(file, root, _BASIC) < 0:
        raise OSError("HDF5 cannot read its names")
    links = _Found({tuple(root.token): b"/"}, [])

    def visit(_: int, name: bytes, info: Any, __: Any) -> int:
        """Give 1 to end the walk."""
        kind, target = info.contents.type, tuple(info.contents.target)
        if kind not in (_HARD, _SOFT):
            links.reasons.append(f"{_shown(name)} is a link to another file")
        elif kind == _SOFT:
            links.reasons.append(f"{_shown(name)} is a symbolic link")
        elif target in links.objects:
            links.reasons.append(f"{_shown(name)} is a second name of {_shown(links.objects[target])}")
        elif len(links.objects) > _MOST_LINKS or name.count(b"/") > _DEEPEST:
            links.reasons.append(f"more than {_MOST_LINKS:,} variables, or groups in groups deeper than {_DEEPEST}")
        else:
            links.objects[target] = name
            if reason := _outside(library, file, name):
                links.reasons.append(f"{_shown(name)} {reason}")
        return 1 if links.reasons else 0

    if library.H5Lvisit2(file, _BY_NAME, _AS_STORED, _VISIT(visit), None) < 0 and not links.reasons:
        raise OSError("HDF5 cannot read its names")
    return links


def _outside(library: ctypes.CDLL, file: int, name: bytes) -> str:
    """The reason for which an object is refused; empty if all its values are in the file."""
    item = library.H5Oopen(file, name, 0)
    if item < 0:
        return "cannot be read"
    try:
        if library.H5Iget_type(item) != _DATASET:
            return ""
        created = library.H5Dget_create_plist(item)
        try:
            count, layout = library.H5Pget_external_count(created), library.H5Pget_layout(created)
        finally:
            library.H5Pclose(created)
    finally:
        library.H5Oclose(item)
    if count < 0 or layout < 0:
        return "cannot be read"
    return "takes its values from another file" if count or layout == _VIRTUAL else ""


def _shown(name: bytes) -> str:
    return repr(name.decode("utf-8", "replace")[:80])
