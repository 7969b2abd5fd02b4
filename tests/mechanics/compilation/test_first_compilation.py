"""The first compilation in a version: one process compiles and says so, the others wait for its machine code."""

from __future__ import annotations

import gc
import json
import multiprocessing
import os
import subprocess
import time

import pytest

from started import Process
from tripod_doe.mechanics.compilation.first_compilation import compilations, first_compilation

COPY = """
import json, sys, time
from pathlib import Path
import numpy as np
from tripod_doe.mechanics.compilation.kernels import kernel
from tripod_doe.mechanics.compilation.first_compilation import first_compilation
from tripod_doe.mechanics.solve.equations_of_motion import copy_vectors
copy_vectors = kernel(copy_vectors.py_func)  # it was imported with another folder for machine code
with first_compilation(sys.argv[1], 1):
    print("here", flush=True)
    while not Path(sys.argv[2]).exists():
        time.sleep(0.01)
    copy_vectors(np.ones((1, 3)), np.ones((1, 3)))
stats = copy_vectors.stats
print(json.dumps([sum(stats.cache_hits.values()), sum(stats.cache_misses.values())]))
"""
"""Compiles as soon as a file is there, and answers how many kernels it loaded and compiled."""

WAITING = "process {} is compiling kernels, once for all: waiting for it (seconds to a minute on an idle machine)\n"


@pytest.fixture
def start(tmp_path):
    """Start a process that compiles into a folder which is empty at first."""
    started = []
    script, go = tmp_path / "compile_once.py", tmp_path / "go"
    script.write_text(COPY)

    def start(kernels="model copy"):
        process = Process([str(script), kernels, str(go)], os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)})
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.wait()
        process.stdout.close()
        process.stderr.close()


@pytest.fixture
def finish(tmp_path):
    """Let processes compile, and give hits and misses of the cache, and what stands on standard error."""

    def finish(process):
        (tmp_path / "go").touch()
        answer, messages = process.communicate()
        return json.loads(answer.splitlines()[-1]), messages.splitlines()

    return finish


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))


@pytest.mark.slow
def test_one_process_compiles_and_the_other_waits_for_its_machine_code(start, finish, tmp_path, monkeypatch):
    first = start()
    assert first.stdout.readline() == "here\n"
    second = start()
    assert second.stderr.readline() == WAITING.format(first.pid)  # the first has not yet compiled
    counts, messages = finish(first)
    assert counts == [0, 1]
    assert messages == [
        "compiling kernels of model copy, once per version: at most about 1 s on an idle machine",
        messages[-1],
    ]
    assert messages[-1].startswith("compiled in ")
    assert finish(second) == ([1, 0], [])
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert compilations("model copy") == {"tripod_doe.mechanics.solve.equations_of_motion.copy_vectors": 1}


@pytest.mark.slow
def test_other_kernels_are_compiled_meanwhile_and_a_process_that_is_killed_lets_the_next_one_compile(start, finish):
    first, other = start("model a"), start("model b")
    assert first.stdout.readline() == other.stdout.readline() == "here\n"
    second = start("model a")
    assert second.stderr.readline() == WAITING.format(first.pid)
    first.kill()
    assert finish(second)[0] == [0, 1]


def test_a_compilation_within_a_compilation_does_not_wait_for_itself(empty_cache, capsys):
    with first_compilation("model a", 20), first_compilation("model b", 10):
        pass
    with first_compilation("model a", 20), first_compilation("model b", 10):
        pass
    announced = [line for line in capsys.readouterr().err.splitlines() if line.startswith("compiling")]
    assert announced == [
        "compiling kernels of model a, once per version: at most about 20 s on an idle machine",
        "compiling kernels of model b, once per version: at most about 10 s on an idle machine",
    ]


def test_a_program_runs_meanwhile_only_where_kernels_are_compiled(empty_cache, tmp_path, monkeypatch):
    """Kernels that are needed next are compiled at the same time: a first run waits a third less."""
    made = tmp_path / "made"
    program = f"open({str(made)!r}, 'w').close()"
    with first_compilation("model a", 1, program):
        until = time.monotonic() + 30
        while not made.exists():
            assert time.monotonic() < until
            time.sleep(0.01)
    monkeypatch.setattr(subprocess, "Popen", None)
    with first_compilation("model a", 1, program):
        pass


def test_no_garbage_is_looked_for_meanwhile(empty_cache):
    """A compiler makes many objects and little garbage: looking for it took 7 % of its time."""
    gc.enable()  # a thread that an earlier test has left may be compiling
    with first_compilation("model a", 20):
        assert not gc.isenabled()
    assert gc.isenabled()


def test_what_failed_to_compile_is_announced_again(empty_cache, capsys):
    for _ in range(2):
        with pytest.raises(MemoryError), first_compilation("model a", 20):
            raise MemoryError
    messages = capsys.readouterr().err
    assert messages.count("compiling kernels") == 2
    assert "compiled in" not in messages


def test_a_folder_that_cannot_be_written_is_done_without(tmp_path, monkeypatch, capsys):
    (tmp_path / "file").touch()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file"))
    with first_compilation("model a", 20):
        pass
    assert "compiling kernels of model a" in capsys.readouterr().err


def compile_in_a_worker():
    with first_compilation("model a", 20):
        pass


def test_workers_are_silent(empty_cache, capfd):
    worker = multiprocessing.get_context("spawn").Process(target=compile_in_a_worker)
    worker.start()
    worker.join()
    assert worker.exitcode == 0
    assert capfd.readouterr().err == ""
