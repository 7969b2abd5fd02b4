"""What a long list of runs costs: opened, filtered and sorted by a program, and in Chromium.

    python benchmarks/run_list.py [--runs 2000]

The table of runs is filled with runs of six questions, ten tags and twenty folders, of the last year. In the browser,
opening runs from the address to the list drawn, and filtering from the last letter to the list drawn, the pause of 25 ms in
which it waits for more letters included. CPU time is that of the server's process and of the page's main thread.
"""

from __future__ import annotations

import argparse
import os
import shutil
import tempfile
import time
import urllib.request
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright
from service_load import Server, cpu_of

from tripod_doe.service.runs.run_table import PointCounts, Run, RunTable, State, stamp

QUESTIONS = (
    "Which angle is worst?",
    "Which friction?",
    "How far does it scatter?",
    "Coast or drive?",
    "",
    "Which bore?",
)
OPENED = "() => performance.getEntriesByType('navigation')[0].domContentLoadedEventEnd"
FILTERED = """(word) => new Promise((resolve) => {
  const field = document.querySelector("#find [name=text]"), start = performance.now();
  new MutationObserver((_, watcher) => {
    watcher.disconnect();
    requestAnimationFrame(() => setTimeout(() => resolve(performance.now() - start)));
  }).observe(document.getElementById("list"), { childList: true, subtree: true });
  field.value = word;
  field.dispatchEvent(new Event("input", { bubbles: true }));
})"""


def fill(folder: Path, count: int) -> None:
    """Write a table of runs that have ended, and their empty directories."""
    random, table = np.random.default_rng(5), RunTable(folder)
    first = datetime.now(UTC) - timedelta(days=365)
    for at in range(count):
        begun = stamp(first + timedelta(days=365) * at / count)
        name = f"customer-{at % 20}/joint-{at % 7}/torque map {at}"
        plan = {"factors": ["joint_angle_deg", "torque_n_m"], "models": ["kinetostatic"], "expected_outcomes": []}
        done = int(random.integers(1, 5_000))
        state = (State.FINISHED, State.FINISHED, State.STOPPED, State.FAILED)[at % 4]
        counts = PointCounts(5_000, done, at % 3, {"finished": done}, done * 0.02)
        run = Run(f"{at:016x}", "study", name, QUESTIONS[at % 6], state, plan=plan, counts=counts)
        table.put(run.changed(created=begun, tags=(f"tag-{at % 10}",), note="As agreed with the customer. " * 5))
        (folder / run.id).mkdir()
    table.close()


def at_the_server(server: Server, count: int) -> None:
    """The list and its parts, asked for by a program."""
    for what, place in (
        ("page of the list", "/"),
        ("list filtered by two words", "/parts/runs?text=torque+1999"),
        ("list filtered by tag and state, by name", "/parts/runs?tag=tag-3&state=failed&sort=name"),
        ("all runs as JSON", "/api/v1/runs"),
        ("runs as JSON filtered by a word", "/api/v1/runs?text=torque+1999"),
    ):
        seconds, used = [], cpu_of(server)
        for _ in range(count):
            headers = {"Authorization": f"Bearer {server.token}"}
            request = urllib.request.Request(f"http://127.0.0.1:{server.port}{place}", headers=headers)
            started = time.perf_counter()
            urllib.request.urlopen(request).read()
            seconds.append(time.perf_counter() - started)
        print(f"{what}: {1e3 * (cpu_of(server) - used) / count:.0f} CPU-ms each; {_wall(1e3 * np.array(seconds))}")


def _wall(milliseconds: np.ndarray) -> str:
    load = os.getloadavg()[0]
    return f"wall: median {np.median(milliseconds):.0f} ms, least {min(milliseconds):.0f} ms at load {load:.1f}"


def in_the_browser(server: Server, count: int) -> None:
    """The list opened, and filtered by words that each leave some runs."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"]
        )
        page = browser.new_page()
        page.goto(f"http://127.0.0.1:{server.port}/?token={server.token}")
        browser_side = page.context.new_cdp_session(page)
        browser_side.send("Performance.enable", {"timeDomain": "threadTicks"})  # CPU time of the page's main thread

        def page_seconds() -> float:
            metrics = browser_side.send("Performance.getMetrics")["metrics"]
            return next(metric["value"] for metric in metrics if metric["name"] == "TaskDuration")

        def opened(_: int) -> tuple[float, float]:
            page.goto(page.url)
            return page.evaluate(OPENED), page_seconds()  # which counts from the start of the page

        def filtered(at: int) -> tuple[float, float]:
            before = page_seconds()
            return page.evaluate(FILTERED, f"torque {17 * at + 101}"), page_seconds() - before

        for what, act in (("opened", opened), ("filtered", filtered)):
            wall, of_page, of_server = [], [], []
            for at in range(count):
                time.sleep(1)  # until what the last turn asked for has ended
                before = cpu_of(server)
                milliseconds, seconds = act(at)
                (
                    wall.append(milliseconds),
                    of_page.append(1e3 * seconds),
                    of_server.append(1e3 * (cpu_of(server) - before)),
                )
            print(
                f"in Chromium, {what}: {np.mean(of_server):.0f} CPU-ms of the server, "
                f"{np.median(of_page):.0f} of the page; {_wall(np.array(wall))}"
            )
        assert page.locator("table.runs tbody tr").count() < 100
        browser.close()


def measure(runs: int, count: int = 15) -> None:
    """Measure, and print a line for each figure."""
    with tempfile.TemporaryDirectory() as name:
        fill(Path(name), runs)
        server = Server(Path(name))
        try:
            at_the_server(server, count)
            in_the_browser(server, count)
        finally:
            server.end()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=2000, help="number of runs")
    measure(parser.parse_args().runs)
