"""The worked examples of docs/guides/extending.md, applied to a copy of the sources and run."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from tripod_doe.mechanics.compilation.sources import cache_root, hash_sources, source_hashes

ROOT = Path(__file__).parent.parent
SECTIONS = (ROOT / "docs" / "guides" / "extending.md").read_text().split("\n## ")[1:]
KEPT = cache_root() / "examples"


def blocks(section):
    """Code blocks of a section: language and text."""
    return re.findall(r"```(python|diff)\n(.*?)```", section, re.DOTALL)


def apply(section, folder):
    """Write the new files and make the changes of a section; returns the files touched."""
    touched = []
    for language, text in blocks(section):
        head, _, body = text.partition("\n")
        if language == "python" and head.startswith("# src/"):
            touched.append(head[2:])
            (folder / head[2:]).write_text(body)
        elif language == "diff":
            touched.append(head.removeprefix("--- "))
            path = folder / touched[-1]
            source = path.read_text()
            for hunk in body.split("...\n"):
                lines = hunk.splitlines(keepends=True)
                before = "".join(line[1:] for line in lines if line[0] in " -")
                after = "".join(line[1:] for line in lines if line[0] in " +")
                assert source.count(before) == 1, f"{touched[-1]}: not once there:\n{before}"
                source = source.replace(before, after)
            path.write_text(source)
    return touched


def keep_machine_code(theirs):
    """A folder for the kernels of the changed sources, with those that are there: the examples change none of them.

    What the examples add is kept there, too, under a hash of all sources: a warm cache compiles nothing.
    """
    ours, kept = cache_root() / f"kernels-{source_hashes().kernels}", KEPT / f"kernels-{theirs}"
    if ours.exists() and not kept.exists():
        fresh = kept.with_suffix(f".{os.getpid()}")
        shutil.copytree(ours, fresh, copy_function=os.link, ignore=shutil.ignore_patterns("*.lock"))
        with suppress(OSError):  # another process has made it meanwhile
            fresh.rename(kept)
        shutil.rmtree(fresh, ignore_errors=True)


@pytest.fixture(scope="module")
def extended(tmp_path_factory):
    """A copy of the sources with all examples, and the files that each touches."""
    folder = tmp_path_factory.mktemp("extended")
    shutil.copytree(ROOT / "src", folder / "src", ignore=shutil.ignore_patterns("*.egg-info"))
    touched = {section: apply(section, folder) for section in SECTIONS}
    keep_machine_code(hash_sources(folder / "src" / "tripod_doe").kernels)
    return folder, touched


CHECKS = """
import contextlib, json, sys, traceback
answers = {}
for section, check in json.load(sys.stdin).items():
    try:
        with contextlib.redirect_stdout(sys.stderr):
            exec(check, {"__name__": "__main__"})
        answers[section] = ""
    except Exception:
        answers[section] = traceback.format_exc()
json.dump(answers, sys.stdout)
"""
"""Runs checks by section, and answers what each of them raised."""


@pytest.fixture(scope="module")
def answers(extended):
    """What the checks of all sections say, in one fresh process on the changed sources."""
    checks = {
        section: next(text for language, text in blocks(section) if language == "python" and text.startswith("# check"))
        for section in SECTIONS
    }
    folder, _ = extended
    environment = os.environ | {"PYTHONPATH": str(folder / "src"), "NUMBA_CACHE_DIR": str(KEPT)}
    done = subprocess.run(
        [sys.executable, "-c", CHECKS],
        cwd=folder,
        env=environment,
        input=json.dumps(checks),
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.slow
@pytest.mark.parametrize("section", SECTIONS, ids=lambda section: section.partition("\n")[0])
def test_an_example_works_and_touches_as_many_files_as_it_says(extended, answers, section):
    """Exact: each worked example of docs/guides/extending.md, on a copy of the sources in a fresh process, as printed there."""
    stated = re.search(r"^(\d+) files?:", section, re.MULTILINE)
    assert int(stated[1]) == len(set(extended[1][section]))
    assert answers[section] == ""
