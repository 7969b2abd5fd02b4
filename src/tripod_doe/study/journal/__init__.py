"""Finished blocks of points in ``journal.sqlite``: committed one by one, read while a run goes on, rescued from damage.

The cube is made elsewhere.
"""

from tripod_doe.study.journal.damage import (
    COMPUTING,
    KERNELS,
    OUTDATED,
    POINTS,
    SHOWN,
    STUDY,
    STUDY_HASH,
    damage,
    text_digest,
)
from tripod_doe.study.journal.finished_block import FinishedBlock
from tripod_doe.study.journal.journal import PILOT, FinishedEnds, Journal, Mark, journal_path

__all__ = [
    "COMPUTING",
    "KERNELS",
    "OUTDATED",
    "PILOT",
    "POINTS",
    "SHOWN",
    "STUDY",
    "STUDY_HASH",
    "FinishedBlock",
    "FinishedEnds",
    "Journal",
    "Mark",
    "damage",
    "journal_path",
    "text_digest",
]
