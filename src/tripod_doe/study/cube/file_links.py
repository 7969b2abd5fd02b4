"""Refusal of netCDF files with links or storage outside the file or in a circle, which HDF5 and netCDF4 would follow.

HDF5 reads values from any file that an external link, a list of external files or a virtual data set names. So a
stranger's cube could read other files of its user. Groups that contain themselves are followed endlessly. All links are
checked, without following any, before netCDF4 opens the file. Our files have one name for each object.
"""

from pathlib import Path
from typing import Any

from tripod_doe.errors import CubeError
from tripod_doe.study.cube.netcdf_lock import NETCDF_LOCK

_CLASSIC = (b"CDF\x01", b"CDF\x02", b"CDF\x05")  # netCDF files without HDF5, which hold no links
# netCDF takes up to 1 ms for each name, and 40,000 groups or more end the process
_MOST_LINKS, _DEEPEST = 5_000, 30


def refuse_outside(path: str | Path) -> None:
    """Refuse a netCDF file that takes values from other files or has links, without following one of those.

    Raises:
        CubeError: With the name of the variable or link.
        OSError: If it is no netCDF file, or damaged.
    """
    with open(path, "rb") as stream:
        if stream.read(4) in _CLASSIC:
            return
    import h5py  # its own HDF5 library shares no open file with the one in netCDF4

    try:
        with NETCDF_LOCK, h5py.File(path, "r", locking=False) as file:
            reason = _reason(file, "", {_identity(file): "/"})
    except (RuntimeError, KeyError, ValueError, TypeError) as error:
        raise OSError(f"HDF5 cannot read its names: {error}") from error
    if reason:
        raise CubeError(f"{path}: {reason}; it is not read")


def _reason(group: Any, above: str, known: dict[object, str]) -> str:
    """The reason to refuse a group; empty if all that it holds is in it alone.

    Args:
        known: Names of all objects that were found before; those in the group are added.
    """
    import h5py

    for name in group:
        place, link = f"{above}{name}", group.get(name, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            return f"{_shown(place)} is a link to another file"
        if not isinstance(link, h5py.HardLink):
            return f"{_shown(place)} is a symbolic link"
        item = group[name]
        if (first := known.setdefault(_identity(item), place)) is not place:
            return f"{_shown(place)} is a second name of {_shown(first)}"
        if len(known) > _MOST_LINKS or place.count("/") > _DEEPEST:
            return f"more than {_MOST_LINKS:,} variables, or groups in groups deeper than {_DEEPEST}"
        if isinstance(item, h5py.Dataset) and (item.external or item.is_virtual):
            return f"{_shown(place)} takes its values from another file"
        if not isinstance(item, h5py.Group) and _is_strange_float(item.id):
            return f"{_shown(place)} is of floating-point numbers of neither 4 nor 8 bytes, at which netCDF crashes"
        if isinstance(item, h5py.Group) and (reason := _reason(item, f"{place}/", known)):
            return reason
    return ""


def _is_strange_float(item: Any) -> bool:
    """Whether a dataset or a named type is of half or extended precision, which ends the process in netCDF 4.10."""
    from h5py import h5t

    kind = item if isinstance(item, h5t.TypeID) else item.get_type()
    return kind.get_class() == h5t.FLOAT and kind.get_size() not in (4, 8)


def _identity(item: Any) -> object:
    from h5py import h5o

    return h5o.get_info(item.id).addr


def _shown(name: str) -> str:
    return repr(name[:80])
