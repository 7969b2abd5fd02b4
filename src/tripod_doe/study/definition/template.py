"""Files to start from: study files with comments (in `templates`), and the examples that the documentation names."""

import shutil
import sys
from pathlib import Path

from tripod_doe.errors import InputError

TEMPLATES = ("grid", "sensitivity", "contribution", "response-surface", "tolerance", "what-if", "multifidelity")
"""Kinds of studies to start from."""

EXAMPLES = ("studies", "workflows", "optimisations", "measurements")
"""Folders of the examples."""


def examples_place() -> Path | None:
    """The folder with the folders of the examples: of pip's installation, or of a clone; None without them."""
    places = (Path(sys.prefix) / "share" / "tripod-doe", Path(__file__).parents[4])
    return next((place for place in places if all((place / name).is_dir() for name in EXAMPLES)), None)


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
        raise InputError(f"{path}: quotes, backslashes and control characters are not allowed in the name of a study")
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text.replace("NAME", path.stem))
    except FileExistsError as error:
        raise InputError(f"{path}: this file exists; choose another name") from error
    except OSError as error:
        raise InputError(f"{path}: cannot write: {error.strerror}") from error
    return path


def write_examples(folder: str | Path = ".") -> list[Path]:
    """Copy the example files that the documentation names: studies, workflows, optimisations and records.

    Args:
        folder: Where to; it gets the folders of `EXAMPLES`.

    Returns:
        The new folders.

    Raises:
        InputError: If one of them is there already, or cannot be written, or the installation has no examples.
    """
    place = examples_place()
    if place is None:
        raise InputError("this installation has no example files: install a wheel with pip, or use a clone")
    made = [Path(folder) / name for name in EXAMPLES]
    for target in made:
        if target.exists():
            raise InputError(
                f"{target}: this folder exists; choose another place: tripod-doe init FOLDER --kind examples"
            )
    try:
        for target in made:
            shutil.copytree(place / target.name, target, ignore=shutil.ignore_patterns("make_*.py", "__pycache__"))
    except OSError as error:
        raise InputError(f"{folder}: cannot write: {error.strerror or error}") from error
    return made
