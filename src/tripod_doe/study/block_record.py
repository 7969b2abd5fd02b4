"""A finished block as bytes: preamble, header, arrays, with a checksum over all, so that damage is always noticed.

Preamble: a mark, the block's number in its file, lengths of header and arrays, CRC-32 of all that follows the mark but
itself. Header: JSON. Arrays: raw, each from a multiple of eight bytes. A reader that meets damage goes on at the next
mark whose checksum holds.
"""

from __future__ import annotations

import json
import math
import struct
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.simulator import WORK, BlockResult, Retries, Values

MARK = b"\x93block\r\n"
"""Every record begins with it."""

_PREAMBLE = struct.Struct("<QIQI")  # number, bytes of header and arrays, checksum
PREAMBLE = len(MARK) + _PREAMBLE.size
"""Bytes of a record before its header, a multiple of eight."""

_ALIGNED = 8

Buffer = memoryview


@dataclass(frozen=True)
class FinishedBlock:
    """A block of points as it came back from a worker."""

    keys: NDArray[np.void]  # fingerprints of its points, shape (point,)
    result: BlockResult  # what was simulated
    # cpu_seconds, wall_seconds: of the whole block
    cpu_seconds: float
    wall_seconds: float
    worker: str  # name of the process in which it ran; `journal.PILOT` for what the study's pilot ran


@dataclass(frozen=True)
class FinishedEnds:
    """How the points of a block ended."""

    # keys, outcomes: fingerprints and outcomes of its points, shape (point,)
    keys: NDArray[np.void]
    outcomes: NDArray[np.int8]
    cpu_seconds: float  # of the whole block


def encode(block: FinishedBlock, number: int) -> bytes:
    """The record of a block.

    Parameters
    ----------
    block
        The block.
    number
        Of the record in its file, from 0, by which a gap is counted.
    """
    result = block.result
    arrays: dict[str, NDArray[Any]] = {"keys": block.keys}
    arrays |= {name: getattr(result, name) for name in ("outcome", *WORK)}
    header: dict[str, Any] = {
        "cpu_seconds": block.cpu_seconds,
        "wall_seconds": block.wall_seconds,
        "worker": block.worker,
        "dims": {name: values.dims for name, values in result.outputs.items()},
        "detail": _table_of("detail", result.detail, arrays),
    }
    if units := {name: values.unit for name, values in result.outputs.items() if values.unit}:
        header["units"] = units
    arrays |= {f"output/{name}": values.data for name, values in result.outputs.items()}
    arrays |= {f"coordinate/{name}": labels for name, labels in result.coordinates.items()}
    arrays |= {f"settled/{name}": column for name, column in result.settled.items()}
    if retries := result.retries:
        header["first_detail"] = _table_of("first_detail", retries.first_detail, arrays)
        arrays |= {"attempt": retries.attempt, "first_outcome": retries.first_outcome}
        arrays |= {f"used/{name}": column for name, column in retries.used.items()}
    header["arrays"] = [[name, array.dtype.str, array.shape] for name, array in arrays.items()]
    head = _padded(json.dumps(header).encode(), b" ")
    body = b"".join(_padded(np.ascontiguousarray(array).tobytes(), b"\0") for array in arrays.values())
    checksum = _checksum(number, len(head), len(body), [head, body])
    return b"".join((MARK, _PREAMBLE.pack(number, len(head), len(body), checksum), head, body))


def record_size(beginning: bytes | Buffer) -> int | None:
    """Bytes of the record that begins with `PREAMBLE` bytes; None where no record does."""
    if len(beginning) < PREAMBLE or beginning[: len(MARK)] != MARK:
        return None
    _, head, body, _ = _PREAMBLE.unpack_from(beginning, len(MARK))
    return int(PREAMBLE + head + body)


def record_number(record: bytes | Buffer) -> int | None:
    """The number of a record, None where it is not as it was written."""
    if record_size(record[:PREAMBLE]) != len(record):
        return None
    number, head, body, checksum = _PREAMBLE.unpack_from(record, len(MARK))
    whole = _checksum(number, head, body, [record[PREAMBLE:]]) == checksum
    return int(number) if whole else None


def decode(record: Buffer) -> FinishedBlock:
    """The block of a whole record; its arrays share the record's memory."""
    header, arrays = _opened(record)

    def named(prefix: str) -> dict[str, NDArray[Any]]:
        return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}

    retries = None
    if "attempt" in arrays:
        first = arrays["first_outcome"], _texts("first_detail", header, arrays)
        retries = Retries(arrays["attempt"], *first, named("used/"))
    outputs, units = named("output/"), header.get("units", {})
    result = BlockResult(
        outputs={
            name: Values(tuple(dims), outputs[name], units.get(name, "")) for name, dims in header["dims"].items()
        },
        coordinates=named("coordinate/"),
        detail=_texts("detail", header, arrays),
        settled=named("settled/"),
        retries=retries,
        **{name: arrays[name] for name in ("outcome", *WORK)},
    )
    return FinishedBlock(arrays["keys"], result, header["cpu_seconds"], header["wall_seconds"], header["worker"])


def decode_keys(record: Buffer) -> NDArray[np.void]:
    """Fingerprints of the points of a whole record; a copy, which does not keep the record in memory."""
    return _opened(record, 1)[1]["keys"].copy()


def decode_ends(record: Buffer) -> FinishedEnds:
    """How the points of a whole record ended; copies, which do not keep the record in memory."""
    header, arrays = _opened(record, 2)
    return FinishedEnds(arrays["keys"].copy(), arrays["outcome"].copy(), header["cpu_seconds"])


def _opened(record: Buffer, first: int | None = None) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Header and arrays of a record, or the first ones: fingerprints, outcomes."""
    _, head, _, _ = _PREAMBLE.unpack_from(record, len(MARK))
    header: dict[str, Any] = json.loads(bytes(record[PREAMBLE : PREAMBLE + head]))
    arrays, at = {}, PREAMBLE + head
    for name, kind, shape in header["arrays"][:first]:
        dtype, count = np.dtype(kind), math.prod(shape)
        arrays[name] = np.frombuffer(record, dtype, count, at).reshape(shape)
        at += -(-count * dtype.itemsize // _ALIGNED) * _ALIGNED
    return header, arrays


def _padded(text: bytes, filler: bytes) -> bytes:
    return text + filler * (-len(text) % _ALIGNED)


def _checksum(number: int, head: int, body: int, parts: Iterable[bytes | Buffer]) -> int:
    checksum = zlib.crc32(struct.pack("<QIQ", number, head, body))
    for part in parts:
        checksum = zlib.crc32(part, checksum)
    return checksum


def _table_of(name: str, texts: list[str], arrays: dict[str, NDArray[Any]]) -> list[str]:
    """The different texts of a block; which of them each point has becomes an array where they are several."""
    table = {text: code for code, text in enumerate(dict.fromkeys(texts))}
    if len(table) > 1:
        arrays[f"{name}_code"] = np.array([table[text] for text in texts], np.int32)
    return list(table)


def _texts(name: str, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> list[str]:
    table = header[name]
    codes = arrays.get(f"{name}_code")
    if codes is None:
        return [*table] * arrays["outcome"].size
    return [table[code] for code in codes.tolist()]
