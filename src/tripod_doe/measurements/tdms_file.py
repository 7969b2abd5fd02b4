"""TDMS files of National Instruments, read with npTDMS if installed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tripod_doe.errors import InputError
from tripod_doe.files.regular_files import opened_regular

_MARK = b"TDSm"
_NUMBER = (int, float, np.integer, np.floating)


def is_tdms(path: Path) -> bool:
    """Whether a file starts like a TDMS file."""
    try:
        with opened_regular(path, links=True) as stream:
            return stream.read(len(_MARK)) == _MARK
    except OSError:
        return False


def read_tdms(path: Path) -> tuple[list[str], list[pd.Series[float]], list[str]]:
    """Headings with their units, columns, and properties as lines ``name: value``.

    Reads the channels of the group with the most values: numbers, true and false, time stamps as s since the first.
    Shorter channels end in gaps. Without a time channel, the increment of the longest waveform gives the time. A column
    has the increment and the start of its waveform in s, where these are known, as the attribute ``timing``.

    Raises:
        InputError: If npTDMS is not installed, or the file cannot be read or has no channels.
    """
    try:
        import nptdms
    except ImportError as error:
        raise InputError("a TDMS file: install the reader with pip install npTDMS, or export it") from error
    try:
        file = nptdms.TdmsFile.read(path)
    except Exception as error:  # a damaged file may raise anything in its reader
        raise InputError(f"cannot read this TDMS file: {error}") from error
    groups = [group for group in file.groups() if group.channels()]
    if not groups:
        raise InputError("this TDMS file has no channels")
    group = max(groups, key=lambda own: sum(len(channel) for channel in own.channels()))
    channels = [channel for channel in group.channels() if np.dtype(channel.dtype).kind in "biufM"]
    rows = max((len(channel) for channel in channels), default=0)
    headings, columns = [], []
    for channel in channels:
        unit = str(channel.properties.get("unit_string", channel.properties.get("NI_UnitDescription", "")))
        values = np.asarray(channel[:])
        if values.dtype.kind == "M":
            unit, values = "s", (values - values[:1]) / np.timedelta64(1, "s")
        headings.append(f"{channel.name} [{unit}]" if unit else channel.name)
        columns.append(pd.Series(np.pad(values.astype(float), (0, rows - len(channel)), constant_values=np.nan)))
        columns[-1].attrs["timing"] = _timing(channel.properties)
    timed = [column for column in columns if column.attrs["timing"]]
    if timed:
        longest = max(timed, key=lambda column: column.count())
        headings.append("time_s")
        columns.append(pd.Series(np.arange(rows) * longest.attrs["timing"][0]))
        columns[-1].attrs["timing"] = longest.attrs["timing"]
    properties = {**file.properties, **group.properties}
    return headings, columns, [f"{name}: {value}" for name, value in properties.items()]


def _timing(properties: Mapping[str, Any]) -> tuple[float, float] | None:
    """Increment and start of a waveform in s; None where it states no increment, or something else in place of one."""
    increment, offset = (properties.get(f"wf_{name}") for name in ("increment", "start_offset"))
    if not (isinstance(increment, _NUMBER) and 0 < increment < math.inf):
        return None
    began = properties.get("wf_start_time")
    start = began.astype("datetime64[us]").astype(np.int64) / 1e6 if isinstance(began, np.datetime64) else 0.0
    return float(increment), start + (float(offset) if isinstance(offset, _NUMBER) else 0.0)
