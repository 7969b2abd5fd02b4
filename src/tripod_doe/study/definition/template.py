"""Study files to start from, with comments: the files in `templates`."""

from pathlib import Path

from tripod_doe.errors import InputError

TEMPLATES = ("grid", "sensitivity", "contribution", "response-surface", "tolerance", "what-if", "multifidelity")
"""Kinds of studies to start from."""


def write_template(path: str | Path, kind: str = "grid") -> Path:
    """Write a study file to start from.

    Args:
        path: Where to; ``.toml`` is added if missing. The name without it becomes the name of the study.
        kind: One of `TEMPLATES`.

    Returns:
        The file.

    Raises:
        InputError: If the file is there already, or cannot be written.
    """
    path = Path(path)
    path = path if path.suffix == ".toml" else path.with_name(path.name + ".toml")
    from importlib.resources import files  # the command line reads only the names of the kinds

    text = (files("tripod_doe.study.definition") / "templates" / f"{kind}.toml").read_text(encoding="utf-8")
    if '"' in path.stem or "\\" in path.stem or not path.stem.isprintable():
        raise InputError(f"{path}: quotes, backslashes and control characters cannot stand in the name of a study")
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text.replace("NAME", path.stem))
    except FileExistsError as error:
        raise InputError(f"{path}: this file exists; choose another name") from error
    except OSError as error:
        raise InputError(f"{path}: cannot write: {error.strerror}") from error
    return path
