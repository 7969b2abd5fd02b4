"""Uploads of a client: texts with plain file names.

`tripod_doe.study.definition.study_folder`, which reads them, decides which files they may name.
"""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tripod_doe.errors import ForbiddenError, TooLargeError
from tripod_doe.service.limits import Limits

KINDS = ("study", "workflow", "fit", "optimisation")
"""Kinds of files that can be submitted: the key in a request, and the name of the file's first table."""

STUDY = "study.toml"
"""File name of a submitted study."""

UPLOAD = "upload"
"""Folder of a result directory with the files that the client submitted."""

_MARK = "\ufeff"
_RECORDS = (".csv", ".txt")  # endings of tables and records, which may be large


def main_file(kind: str) -> str:
    """File name of a submitted text, by its kind."""
    return f"{kind}.toml"


_PLAIN = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,99}")
_SHOWN = 100  # characters of a name in a message


def upload_texts(body: Mapping[str, Any]) -> tuple[str, dict[str, str]]:
    """The kind of a request and all its texts by name: ``{"study": text, "files": {name: text}}`` or another kind.

    The mark that some editors put in front of a text is left out.

    Raises:
        ForbiddenError: If a file's name is not a plain one.
    """
    kind = next(kind for kind in KINDS if body.get(kind) is not None)
    main = main_file(kind)
    texts = {main: str(body[kind]).removeprefix(_MARK)}
    for name, text in (body.get("files") or {}).items():
        _check_plain(name, "files")
        if name == main:
            raise ForbiddenError(f"files: {name}: this is the name of the submitted file itself; choose another")
        texts[name] = text.removeprefix(_MARK)
    return kind, texts


def write_upload(folder: Path, texts: Mapping[str, str]) -> None:
    """Write uploaded texts into a new folder."""
    folder.mkdir(parents=True)
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8", newline="")


def refuse_large_texts(size: int, texts: Mapping[str, str], limits: Limits) -> None:
    """Refuse (TooLargeError) a request that is too long without its tables and records.

    Args:
        size: Size of its body in bytes.
    """
    long = sum(len(json.dumps(text)) for name, text in texts.items() if name.endswith(_RECORDS))
    if size - long > limits.body_bytes:
        raise TooLargeError(
            f"the body is larger than {limits.body_bytes:,} bytes besides its .csv and .txt files, the limit here"
        )


def refuse_many_files(texts: Mapping[str, str], limits: Limits) -> None:
    """Refuse (TooLargeError) an upload of too many files."""
    if len(texts) - 1 > limits.files:
        raise TooLargeError(f"files: {len(texts) - 1:,} files; at most {limits.files:,} are taken here")


def _check_plain(name: str, where: str) -> None:
    if not _PLAIN.fullmatch(name) or ".." in name:
        raise ForbiddenError(f"{where}: {name[:_SHOWN]!r}: a plain name is needed: letters, digits, dots, - and _")
