"""BLAKE2b digests (RFC 7693) of many messages that begin alike, compiled.

Some messages are hashed at a time, so that loops over them are vectorised, which one message does not allow. Their
states are one array, word by word; that of a message is each `_LANES`-th number of it.
Indices are unsigned, since one that may be negative, and then counts from the end, keeps a loop from being vectorised.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.mechanics.compilation import inlined_kernel, inner_kernel, kernel

__all__ = ["digests_of"]

_DIGEST, _WORD, _BLOCK = 16, 8, 128
"""Bytes of a digest, of a word, and of a block."""

_LANES = np.uint64(32)
_WORDS = _BLOCK // _WORD

_INITIAL = np.array([
    0x6A09E667F3BCC908, 0xBB67AE8584CAA73B, 0x3C6EF372FE94F82B, 0xA54FF53A5F1D36F1,
    0x510E527FADE682D1, 0x9B05688C2B3E6C1F, 0x1F83D9ABFB41BD6B, 0x5BE0CD19137E2179,
], np.uint64)  # fmt: skip
_BEGIN = _INITIAL ^ np.array([0x01010000 ^ _DIGEST] + 7 * [0], np.uint64)  # no key, no tree

_ORDERS = np.array([
    [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15],
    [14, 10, 4, 8, 9, 15, 13, 6, 1, 12, 0, 2, 11, 7, 5, 3],
    [11, 8, 12, 0, 5, 2, 15, 13, 10, 14, 3, 6, 7, 1, 9, 4],
    [7, 9, 3, 1, 13, 12, 11, 14, 2, 6, 5, 10, 4, 0, 15, 8],
    [9, 0, 5, 7, 2, 4, 10, 15, 14, 1, 11, 12, 6, 8, 3, 13],
    [2, 12, 6, 10, 0, 11, 8, 3, 4, 13, 7, 5, 15, 14, 1, 9],
    [12, 5, 1, 15, 14, 13, 4, 10, 0, 7, 6, 3, 9, 2, 8, 11],
    [13, 11, 7, 14, 12, 1, 3, 9, 5, 0, 15, 4, 8, 6, 2, 10],
    [6, 15, 14, 9, 11, 3, 0, 8, 12, 2, 13, 7, 1, 4, 10, 5],
    [10, 2, 8, 4, 7, 6, 1, 5, 15, 11, 9, 14, 3, 12, 13, 0],
], np.uint64)  # fmt: skip
_ROUNDS = _LANES * np.concatenate([_ORDERS, _ORDERS[:2]])  # where the words of a block begin, for each round


def digests_of(beginning: bytes, ends: NDArray[np.float64]) -> NDArray[np.void]:
    """Digests of 16 bytes of messages.

    Parameters
    ----------
    beginning
        Of all messages.
    ends
        The numbers of each that follow, shape (message, number), at least one.

    Returns
    -------
    ndarray, shape (message,)
    """
    length = len(beginning) + ends.shape[1] * ends.itemsize
    whole = len(beginning) // _BLOCK * _BLOCK
    rest = len(beginning) - whole
    size = -(-(length - whole) // _BLOCK) * _BLOCK
    messages = np.zeros((-(-len(ends) // int(_LANES)) * int(_LANES), size), np.uint8)
    messages[:, :rest] = np.frombuffer(beginning, np.uint8)[whole:]
    messages[: len(ends), rest : length - whole] = np.ascontiguousarray(ends).view(np.uint8)
    found = np.empty((len(messages), _DIGEST // _WORD), np.uint64)
    _hash(np.frombuffer(beginning, np.uint8)[:whole].view(np.uint64), messages.view(np.uint64), length, found)
    return found[: len(ends)].view(f"V{_DIGEST}").ravel()


@kernel
def _hash(beginning: Any, messages: Any, length: int, found: Any) -> None:
    """Digests of messages, in words: what all begin with, and the rest of each; `length` is that of both in bytes."""
    begun, state = np.empty(8 * _LANES, np.uint64), np.empty(8 * _LANES, np.uint64)
    block, work = np.empty(_WORDS * _LANES, np.uint64), np.empty(_WORDS * _LANES, np.uint64)
    for word in range(8):
        begun[word * _LANES : (word + 1) * _LANES] = _BEGIN[word]
    for at in range(0, beginning.size, _WORDS):
        for word in range(_WORDS):
            block[word * _LANES : (word + 1) * _LANES] = beginning[at + word]
        _absorb(begun, block, _WORD * (at + _WORDS), False, work)
    for first in range(0, len(messages), _LANES):
        state[:] = begun
        for at in range(0, messages.shape[1], _WORDS):
            for lane in range(_LANES):
                for word in range(_WORDS):
                    block[word * _LANES + lane] = messages[first + lane, at + word]
            is_last = at + _WORDS == messages.shape[1]
            counted = length if is_last else _WORD * (beginning.size + at + _WORDS)
            _absorb(state, block, counted, is_last, work)
        for lane in range(_LANES):
            for word in range(found.shape[1]):
                found[first + lane, word] = state[word * _LANES + lane]


@inner_kernel
def _absorb(state: Any, block: Any, counted: int, is_last: bool, work: Any) -> None:
    """Take in a block of every message, of which so many bytes are in then."""
    work[: 8 * _LANES] = state
    for word in range(8):
        work[(8 + word) * _LANES : (9 + word) * _LANES] = _INITIAL[word]
    work[12 * _LANES : 13 * _LANES] = _INITIAL[4] ^ np.uint64(counted)
    if is_last:
        work[14 * _LANES : 15 * _LANES] = ~_INITIAL[6]
    for order in _ROUNDS:
        _round(work, block, order)
    for at in range(state.size):
        state[at] ^= work[at] ^ work[8 * _LANES + at]


@inner_kernel
def _round(v: Any, m: Any, at: Any) -> None:
    """Mix the columns of the working state with the words of a block, then its diagonals."""
    n = _LANES
    p0, p1, p2, p3, p4, p5, p6, p7 = at[0], at[1], at[2], at[3], at[4], at[5], at[6], at[7]
    p8, p9, p10, p11, p12, p13, p14, p15 = at[8], at[9], at[10], at[11], at[12], at[13], at[14], at[15]
    for i in range(n):
        a0, b0, c0, d0 = _mix(v[i], v[4 * n + i], v[8 * n + i], v[12 * n + i], m[p0 + i], m[p1 + i])
        a1, b1, c1, d1 = _mix(v[n + i], v[5 * n + i], v[9 * n + i], v[13 * n + i], m[p2 + i], m[p3 + i])
        a2, b2, c2, d2 = _mix(v[2 * n + i], v[6 * n + i], v[10 * n + i], v[14 * n + i], m[p4 + i], m[p5 + i])
        a3, b3, c3, d3 = _mix(v[3 * n + i], v[7 * n + i], v[11 * n + i], v[15 * n + i], m[p6 + i], m[p7 + i])
        v[i], v[5 * n + i], v[10 * n + i], v[15 * n + i] = _mix(a0, b1, c2, d3, m[p8 + i], m[p9 + i])
        v[n + i], v[6 * n + i], v[11 * n + i], v[12 * n + i] = _mix(a1, b2, c3, d0, m[p10 + i], m[p11 + i])
        v[2 * n + i], v[7 * n + i], v[8 * n + i], v[13 * n + i] = _mix(a2, b3, c0, d1, m[p12 + i], m[p13 + i])
        v[3 * n + i], v[4 * n + i], v[9 * n + i], v[14 * n + i] = _mix(a3, b0, c1, d2, m[p14 + i], m[p15 + i])


@inlined_kernel
def _mix(a: Any, b: Any, c: Any, d: Any, x: Any, y: Any) -> Any:
    """The function G: four words of a state and two of a block."""
    a = a + b + x
    d = _turned(d ^ a, 32)
    c = c + d
    b = _turned(b ^ c, 24)
    a = a + b + y
    d = _turned(d ^ a, 16)
    c = c + d
    return a, _turned(b ^ c, 63), c, d


@inlined_kernel
def _turned(word: Any, bits: int) -> Any:
    """A word whose bits are moved to the right, those that fall off to the left."""
    return (word >> np.uint64(bits)) | (word << np.uint64(64 - bits))
