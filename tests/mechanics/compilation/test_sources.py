"""What makes results and machine code stale: changed code, and nothing else."""

from __future__ import annotations

import json
import os
import runpy
import shutil
from pathlib import Path

import pytest

import tripod_doe
from started import Process
from tripod_doe.mechanics.compilation import sources
from tripod_doe.mechanics.compilation.kernels import KernelLocator
from tripod_doe.mechanics.compilation.sources import cache_root, hash_sources, source_hashes

SOURCE = Path(tripod_doe.__file__).parent

COPY_TWICE = """
import json, sys, numpy as np
for name in [name for name in sys.modules if name.partition(".")[0] == "tripod_doe"]:
    del sys.modules[name]  # the process has been forked: the package beside this script is another one
from tripod_doe.mechanics.solve.equations_of_motion import copy_vectors
copy_vectors(np.ones((1, 3)), np.ones((1, 3)))
stats, place = copy_vectors.stats, sys.modules[copy_vectors.__module__].__file__
print(json.dumps([place, sum(stats.cache_hits.values()), sum(stats.cache_misses.values())]))
"""


@pytest.fixture
def package(tmp_path):
    """A copy of the package's Python files; its hashes are `source_hashes`, wherever it stands."""
    folder = tmp_path / "tripod_doe"
    shutil.copytree(SOURCE, folder, ignore=shutil.ignore_patterns("*.html", "*.css"))
    return folder


def change(path, old, new):
    text = path.read_text()
    assert text.count(old) >= 1
    path.write_text(text.replace(old, new, 1))


def reword(package):
    """Better sentences: module and function docstrings, comments, line numbers."""
    change(package / "mechanics" / "solve" / "equations_of_motion.py", '"""', '"""Another word,\nand a line more. ')
    change(
        package / "mechanics" / "solve" / "equations_of_motion.py",
        '    """Copy rows of',
        "    # a comment\n\n" + '    """Rows of',
    )


def test_neither_words_count_nor_what_is_no_code_of_mechanics_or_joint(package):
    """Exact: what is kept in the cache is what the sources give, all of that changed."""
    before = source_hashes()
    reword(package)
    (package / "joint" / "models" / "prices.toml").write_text("[rollers]")
    path = package / "page_parts" / "tables.py"
    path.write_text(path.read_text() + "\nNEW_CONSTANT = 3\n")
    assert hash_sources(package) == before


def test_code_of_a_kernel_counts_for_both(package):
    before = source_hashes()
    change(
        package / "mechanics" / "solve" / "equations_of_motion.py",
        "target[i, d] = source[i, d]",
        "target[i, d] = -source[i, d]",
    )
    after = hash_sources(package)
    assert after.results != before.results
    assert after.kernels != before.kernels


@pytest.mark.slow
def test_a_constant_that_a_kernel_imports_counts_for_both(package):
    """numba compiles the value of a global in: the file that it comes from need not contain a kernel itself."""
    before = source_hashes()
    path = package / "mechanics" / "tables.py"
    path.write_text(path.read_text() + "\nNEW_CONSTANT = 3\n")
    assert hash_sources(package).kernels != before.kernels


def test_code_around_the_kernels_counts_for_results_only(package):
    before = source_hashes()
    path = package / "joint" / "models" / "registry.py"
    path.write_text(path.read_text() + "\nNEW_CONSTANT = 3\n")
    after = hash_sources(package)
    assert after.results != before.results
    assert after.kernels == before.kernels


@pytest.mark.slow
def test_machine_code_is_kept_where_words_change_and_made_again_where_code_does(package, tmp_path):
    script = package.parent / "copy_twice.py"
    script.write_text(COPY_TWICE)

    def hits_and_misses():
        process = Process([str(script)], os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")})
        answer, messages = process.communicate()
        assert answer, messages
        place, *counts = json.loads(answer)
        assert place == str(package / "mechanics" / "solve" / "equations_of_motion.py")
        return counts

    assert hits_and_misses() == [0, 1]
    reword(package)
    assert hits_and_misses() == [1, 0]
    change(
        package / "mechanics" / "solve" / "equations_of_motion.py",
        "target[i, d] = source[i, d]",
        "target[i, d] = -source[i, d]",
    )
    assert hits_and_misses() == [0, 1]


KERNEL = """
from tripod_doe.mechanics.compilation.kernels import kernel
from tripod_doe.mechanics.laws.contact import contact_force
@kernel
def force(x):
    return contact_force(x, 1.0, 1.5)
def plain(x):
    return x
"""


def test_machine_code_of_a_kernel_elsewhere_is_kept_by_the_sources_and_the_text_of_its_file(tmp_path, monkeypatch):
    """Regression: numba looks at that file only; a benchmark measured kernels of this package as they had been before."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    folders = set()
    for text in (KERNEL, KERNEL, KERNEL.replace("1.5", "2.5")):
        path = tmp_path / f"elsewhere_{len(folders)}.py"
        path.write_text(text)
        module = runpy.run_path(str(path))
        folders.add(KernelLocator.from_function(module["force"].py_func, str(path)).get_cache_path())
        assert KernelLocator.from_function(module["plain"], str(path)) is None
    assert {Path(folder).parents[1] for folder in folders} == {
        tmp_path / "cache" / f"kernels-{source_hashes().kernels}"
    }
    assert len(folders) == 2


@pytest.fixture
def without_home(tmp_path, monkeypatch):
    """A user without a home that can be written; gives the name of the temporary cache that lasts."""
    (tmp_path / "no_folder").write_text("")
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "no_folder"))
    monkeypatch.setattr(sources.tempfile, "tempdir", str(tmp_path))
    sources._temporary_cache.cache_clear()
    yield tmp_path / f"tripod_doe-{os.geteuid()}"
    sources._temporary_cache.cache_clear()


def test_without_a_home_the_cache_is_a_temporary_folder_of_the_user_alone(without_home):
    assert cache_root() == without_home
    assert without_home.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("planted", ["open to others", "a link", "of another user"])
def test_a_temporary_cache_that_another_user_may_have_filled_is_not_used(without_home, tmp_path, monkeypatch, planted):
    """Machine code and templates are loaded as they are: who writes there runs code."""
    target = tmp_path / "planted"
    target.mkdir(mode=0o700)
    if planted == "a link":
        without_home.symlink_to(target)
    else:
        target.rename(without_home)
    if planted == "open to others":
        without_home.chmod(0o777)
    if planted == "of another user":
        if os.geteuid():
            pytest.skip("only root can give a folder away")
        os.chown(without_home, 12345, -1)
    folder = cache_root()
    assert folder != without_home
    assert folder.parent == tmp_path
    assert folder.stat().st_mode & 0o777 == 0o700
    assert cache_root() == folder
    monkeypatch.delenv("NUMBA_CACHE_DIR")
