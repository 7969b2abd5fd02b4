"""Requests made from the service's own description, alone and in chains: no internal error, no answer beside the schema.

    python benchmarks/service_cases.py [--cases 10000] [--seed 1]

Schemathesis makes requests from the OpenAPI description, valid ones and others, and chains of them that hand ids on:
submit, plan, stop, resume, retry, extend, delete, query. Between two steps a run may be killed. Studies are mostly ones
that can run; what runs is a stand-in that holds the lock of its directory and ends, so that thousands of runs cost little;
two finished studies are there to be asked. Event streams, which do not end, are left out.
"""

from __future__ import annotations

import argparse
import fcntl
import os
import random
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

import schemathesis
from fastapi import FastAPI
from hypothesis import HealthCheck, Phase, settings
from hypothesis import seed as with_seed
from hypothesis.errors import FlakyStrategyDefinition
from hypothesis.stateful import rule, run_state_machine_as_test
from schemathesis.generation import GenerationMode
from schemathesis.specs.openapi.checks import positive_data_acceptance  # no schema tells which text is a study
from starlette.testclient import TestClient

import tripod_doe as td
from tripod_doe.service.app import create_app
from tripod_doe.service.limits import Limits
from tripod_doe.service.runs import processes
from tripod_doe.service.settings import Settings

TOKEN = "a-token-of-these-cases"
STUDY = """[study]
name = "{name}"
[base]
model = "equilibrium"
[factors.joint_angle_deg]
values = [4, 12{more}]
[factors.torque_n_m]
values = [-50, 90]
[keep]
outputs = ["thrust_amplitude"]
"""
JAMMED = STUDY.replace('"equilibrium"', '"equilibrium"\nbearing_radial_clearance_mm = -0.05')
WORKFLOW = '[workflow]\nname = "chain"\n[steps.a]\nkind = "study"\nstudy = "a.toml"\n'
STAND_IN = "import signal, time; signal.signal(signal.SIGINT, lambda *_: exit(130)); time.sleep(0.2)"
_PATIENCE = 300  # seconds, on a busy machine
QUICK = settings(
    deadline=None, phases=[Phase.generate], suppress_health_check=list(HealthCheck), database=None, print_blob=False
)


def start_stand_in(directory: Path, words: list[str]) -> None:
    """A process that looks like a run."""
    lock = os.open(directory / ".alive", os.O_CREAT | os.O_RDWR)
    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    words = [sys.executable, "-S", "-c", STAND_IN, "tripod_doe.cli", *words]
    child = subprocess.Popen(words, stderr=subprocess.DEVNULL, start_new_session=True, pass_fds=(lock,))
    os.ftruncate(lock, 0)
    os.write(lock, f"{child.pid}\n".encode())
    os.close(lock)
    threading.Thread(target=child.wait, daemon=True).start()


def schema_of(app: FastAPI, tally: Counter[str]) -> schemathesis.BaseSchema:
    """The description, and hooks that make a part of the requests meaningful."""
    schema = schemathesis.openapi.from_asgi("/api/v1/openapi.json", app, headers={"Authorization": f"Bearer {TOKEN}"})
    schema = schema.exclude(path_regex="events$")
    service = app.state.service

    @schemathesis.hook
    def before_call(context, case, kwargs):
        case.headers["Authorization"] = f"Bearer {TOKEN}"
        body = case.body if isinstance(case.body, dict) else {}
        if case.meta is not None and case.meta.generation.mode is not GenerationMode.POSITIVE:
            return  # what is meant to be wrong stays so
        if "timing" in body or case.path.endswith("/plans"):
            body["timing"] = False  # ten seconds each otherwise
        if case.path.endswith(("/runs", "/plans", "/extend")) and case.method == "POST" and random.random() < 0.6:
            body.clear()
            body[random.choice(["study", "study", "workflow"])] = ""
        if body.get("study") is not None and random.random() < 0.9:
            more = random.choice(["", ", 15", ", 15, 18"])
            body |= {"study": random.choice([STUDY, JAMMED]).format(name="any", more=more), "files": {}}
            body.pop("workflow", None)
        elif body.get("workflow") is not None and random.random() < 0.9:
            body |= {"workflow": WORKFLOW, "files": {"a.toml": STUDY.format(name="a", more="")}}
            body.pop("study", None)
        ids = [run.id for run in service.runs.all() if case.method != "DELETE" or not run.place]
        if "run_id" in (case.path_parameters or {}) and ids and random.random() < 0.7:
            case.path_parameters["run_id"] = random.choice(ids)
        if (case.query or {}).get("variable") and random.random() < 0.6:
            case.query["variable"] = random.choice(["thrust_amplitude", "outcome", "outcome_detail", "cpu_seconds"])

    @schemathesis.hook
    def after_call(context, case, response):
        tally[f"{case.method} {case.path}: {response.status_code}"] += 1
        assert response.elapsed < 60, case.path

    return schema


def chains(schema: schemathesis.BaseSchema, folder: Path, count: int, steps: int, seed: int) -> None:
    """Chains of requests that hand ids on, with kills between them."""
    base = schema.as_state_machine()

    class Chains(base):  # type: ignore[misc, valid-type]
        def get_call_kwargs(self, case) -> dict[str, object]:
            return {"timeout": _PATIENCE}

        def validate_response(self, response, case, additional_checks=(), **kwargs) -> None:
            case.validate_response(response, excluded_checks=[positive_data_acceptance])

        @rule()
        def kill(self) -> None:
            for directory in (
                random.sample(sorted(folder.glob("[0-9a-f]*")), 1) if any(folder.glob("[0-9a-f]*")) else []
            ):
                processes.kill_run(directory)

    few = settings(QUICK, max_examples=2, stateful_step_count=steps)  # the first one is always the simplest
    for at in range(count):  # each by itself: what a server answers depends on what was before
        with suppress(FlakyStrategyDefinition):  # which Hypothesis notices where two begin alike
            run_state_machine_as_test(with_seed(seed + at)(Chains), settings=few)


def singles(schema: schemathesis.BaseSchema, count: int, seed: int) -> None:
    """Requests by themselves, the same number for each route."""
    for result in schema.get_all_operations():
        operation = result.ok()

        @with_seed(seed)
        @settings(QUICK, max_examples=count)
        @schemathesis_given(operation)
        def single(case):
            case.call_and_validate(timeout=_PATIENCE, excluded_checks=[positive_data_acceptance])

        single()


def schemathesis_given(operation: object) -> object:
    """Cases of one route as Hypothesis makes them."""
    from hypothesis import given

    return given(case=operation.as_strategy())


def run_cases(count: int, seed: int) -> Counter[str]:
    """Make about so many requests; gives how often each route answered what.

    Raises
    ------
    Exception
        Of schemathesis, with the request, at the first internal error or answer beside the description.
    """
    random.seed(seed)
    tally: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "results"
        folder.mkdir()
        for kind, text in (("done", STUDY), ("jammed", JAMMED)):
            (folder / f"{kind}.toml").write_text(text.format(name=kind, more=""))
            td.run(folder / f"{kind}.toml", out=folder / kind, workers=0, progress=False)
        limits = Limits(queued=20, cpu_hours=1, simulate_seconds=120, query_seconds=120)
        own, processes.start_run = processes.start_run, start_stand_in
        try:
            app = create_app(Settings(folder, "testserver", token=TOKEN, workers=0, limits=limits))
            with TestClient(app, raise_server_exceptions=False):
                while len(app.state.service.runs.all()) < 2:  # until both have been found
                    time.sleep(0.1)
                schema = schema_of(app, tally)
                routes = sum(1 for _ in schema.get_all_operations())
                singles(schema, max(1, count // 2 // routes), seed)
                chains(schema, folder, max(1, (count - tally.total()) // 10), 10, seed)
                for directory in folder.iterdir():
                    processes.kill_run(directory)
        finally:
            processes.start_run = own
    return tally


def main() -> None:
    """Make the requests, and print what was answered."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    started = time.process_time()
    tally = run_cases(options.cases, options.seed)
    for route, count in sorted(tally.items()):
        print(f"{count:6d}  {route}")
    print(
        f"{tally.total():,} requests in {time.process_time() - started:.0f} s of CPU time: no internal error, "
        "every answer as described"
    )


if __name__ == "__main__":
    main()
