"""What the joint in motion costs: bytes, seconds to load, frames a second, CPU time of the browser for each frame.

    python benchmarks/motion_page.py [--core 1] [--seconds 5] [--against OTHER.html ...]

Chromium without a graphics card plays the reference joint, and drive beside coast. The CPU time is that of all processes
of the browser, so it also holds on a busy machine, where frames are lost; with `--core` they all share one core. Pages of
`--against`, as of an older version, are played in turn with them.
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import psutil
from playwright.sync_api import Browser, sync_playwright

import tripod_doe as td

JOINTS = {"one joint": None, "two joints": {"torque_n_m": -50}}


def browser_seconds() -> float:
    """CPU seconds that all processes of the browser have taken."""
    total = 0.0
    for process in psutil.Process().children(recursive=True):
        try:
            if "chromium" in process.exe():
                total += sum(process.cpu_times()[:2])
        except psutil.Error:
            continue
    return total


def played(browser: Browser, file: Path, seconds: float) -> tuple[float, float, float]:
    """Seconds to load a page and paint it, frames a second, and CPU milliseconds for each."""
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    started = time.perf_counter()
    page.goto(file.as_uri())
    page.evaluate("new Promise((done) => requestAnimationFrame(() => setTimeout(done)))")
    loaded = time.perf_counter() - started
    page.keyboard.press(" ")
    page.wait_for_timeout(1000)

    def frames() -> int:
        return int(page.locator("body").get_attribute("data-frames") or 0)

    first, began, cpu = frames(), time.perf_counter(), browser_seconds()
    page.wait_for_timeout(1000 * seconds)
    shown, took, spent = frames() - first, time.perf_counter() - began, browser_seconds() - cpu
    page.close()
    return loaded, shown / took, 1e3 * spent / max(shown, 1)


def measure(core: int | None, seconds: float, others: Sequence[Path], rounds: int = 3) -> None:
    """Play all pages in turn, and print a line for each."""
    with tempfile.TemporaryDirectory() as name, ExitStack() as opened:
        files = {title: Path(name) / f"{title}.html" for title in JOINTS}
        for title, against in JOINTS.items():
            files[title].write_text(td.view(against=against).page, encoding="utf-8")
        files |= {other.name: other.resolve() for other in others}
        if core is not None:
            os.sched_setaffinity(0, {core})  # the driver of the browser, and the browser, inherit it
        browser = opened.enter_context(sync_playwright()).chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"]
        )
        results: dict[str, list[tuple[float, float, float]]] = {title: [] for title in files}
        for _ in range(rounds):
            for title, file in files.items():
                results[title].append(played(browser, file, seconds))
        for title, rows in results.items():
            loads, rates, costs = zip(*rows, strict=True)
            print(
                f"{title}: {files[title].stat().st_size / 1e6:.2f} MB, loads in {min(loads):.2f} s, {max(rates):.1f} "
                f"frames/s, CPU a frame {min(costs):.1f} ms at least, {statistics.median(costs):.1f} ms median"
            )
        browser.close()


def main() -> None:
    """Measure with a browser of its own."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--core", type=int)
    parser.add_argument("--seconds", type=float, default=5)
    parser.add_argument("--against", type=Path, nargs="*", default=[])
    options = parser.parse_args()
    measure(options.core, options.seconds, options.against)


if __name__ == "__main__":
    main()
