"""What the page costs: bytes of the first load, a slice of a cube at the server and drawn, many points on many axes.

    python benchmarks/service_page.py [--side 46] [--points 100000]

A server on a folder of its own, with a study of `side` x `side` points, and Chromium without a graphics card. The time to
draw runs from the change of a control to the figure that shows it, the request included. On a busy machine the least of
several says most; the time that the browser's main thread was at work stands beside.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
import urllib.request
from pathlib import Path

import numpy as np
from playwright.sync_api import CDPSession, Page, sync_playwright
from service_load import LONG, Server

import tripod_doe as td

DRAWN = "document.getElementById('figure')?.dataset.drawn"
NEXT_SLICE = """() => new Promise((resolve) => {
  const figure = document.getElementById("figure"), start = performance.now();
  new MutationObserver((_, watcher) => {
    watcher.disconnect();
    requestAnimationFrame(() => setTimeout(() => resolve(performance.now() - start)));
  }).observe(figure, { attributeFilter: ["data-drawn"] });
  document.querySelector("#controls [data-by='1']").click();
})"""
MANY = """async ([count, address, kind]) => {
  const draw = (await import(address))[kind];
  const packed = (array, dtype) => {
    const bytes = new Uint8Array(array.buffer);
    let letters = "";
    for (let at = 0; at < bytes.length; at += 8192) letters += String.fromCharCode(...bytes.subarray(at, at + 8192));
    return { dtype, bdata: btoa(letters) };
  };
  const axes = ["a", "b", "c", "d", "e", "f"].map((name) => (
    { name, label: name, values: packed(Float64Array.from({ length: count }, Math.random), "f8") }));
  const figure = {
    axes, numbers: packed(Int32Array.from({ length: count }, (_, at) => at), "i4"), outcome: packed(new Int32Array(count), "i4"),
  };
  const place = document.createElement("div");
  document.querySelector("main").replaceChildren(place);
  const start = performance.now();
  draw(place, figure, { chosen() {}, hovered() {}, describe() {} });
  await new Promise((resolve) => requestAnimationFrame(() => setTimeout(resolve)));
  return performance.now() - start;
}"""


def first_loads(page: Page, session: CDPSession, addresses: dict[str, str]) -> None:
    """Bytes that each page takes when nothing of it is known."""
    for name, address in addresses.items():
        sizes: list[float] = []
        session.send("Network.clearBrowserCache")
        take = lambda event: sizes.append(event["encodedDataLength"])  # noqa: B023, E731
        session.on("Network.loadingFinished", take)
        page.goto(address)
        page.wait_for_timeout(3000)
        session.remove_listener("Network.loadingFinished", take)
        print(f"first load, {name}: {sum(sizes) / 1e3:,.0f} kB in {len(sizes)} answers")


def at_work(session: CDPSession) -> float:
    """Seconds that the browser's main thread has been at work."""
    return next(m["value"] for m in session.send("Performance.getMetrics")["metrics"] if m["name"] == "TaskDuration")


def slices(page: Page, session: CDPSession, address: str, count: int) -> None:
    """From the change of a control to the picture of the next slice."""
    page.goto(address)
    while page.evaluate(DRAWN) is None:
        page.wait_for_timeout(100)
    page.evaluate(NEXT_SLICE)
    before = at_work(session)
    seconds = [page.evaluate(NEXT_SLICE) for _ in range(count)]
    work = (at_work(session) - before) / count
    print(
        f"next slice drawn: median {np.median(seconds):.0f} ms, least {min(seconds):.0f} ms; "
        f"browser at work {1e3 * work:.0f} ms"
    )


def many_points(page: Page, session: CDPSession, server: Server, count: int) -> None:
    """Points on six axes, from the numbers to the picture."""
    page.goto(f"http://127.0.0.1:{server.port}/")
    for module, kind in (("parallel", "drawParallel"), ("matrix", "drawMatrix")):
        before = at_work(session)
        wall = page.evaluate(MANY, [count, f"/assets/{module}.js", kind])
        print(
            f"{count:,} points, {module}: {wall:.0f} ms; browser at work {1e3 * (at_work(session) - before):.0f} ms, "
            "the making of the points included"
        )


def at_the_server(server: Server, run_id: str, points: int, count: int) -> None:
    """The figure of a slice, asked for by a program."""
    seconds = []
    for at in range(count):
        address = f"http://127.0.0.1:{server.port}/api/v1/runs/{run_id}/figure?kind=map&variable=thrust_rms&select=order={at % 13}"
        request = urllib.request.Request(address, headers={"Authorization": f"Bearer {server.token}"})
        started = time.perf_counter()
        urllib.request.urlopen(request).read()
        seconds.append(time.perf_counter() - started)
    print(
        f"slice of {points:,} points at the server: median {1e3 * np.median(seconds):.0f} ms, "
        f"least {1e3 * min(seconds):.0f} ms"
    )


def measure(side: int, points: int, count: int = 15) -> None:
    """Measure, and print a line for each figure."""
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        folder = Path(name)
        (folder / "square.toml").write_text(LONG.format(count=side))
        td.run(folder / "square.toml", out=folder / "square", workers=0, progress=False)
        server = Server(folder, "--workers", "0")
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"]
        )
        try:
            page = browser.new_context(viewport={"width": 1280, "height": 900}).new_page()
            session = page.context.new_cdp_session(page)
            session.send("Network.enable")
            session.send("Performance.enable")
            home = f"http://127.0.0.1:{server.port}"
            page.goto(f"{home}/?token={server.token}")
            page.locator("tr[id] a").first.wait_for()
            run_id = page.locator("tr[id]").first.get_attribute("id").removeprefix("run-")
            first_loads(page, session, {"list of runs": home, "explorer": f"{home}/runs/{run_id}"})
            at_the_server(server, run_id, side * side, count)
            slices(page, session, f"{home}/runs/{run_id}?kind=map&variable=thrust_rms&select=order=0", min(count, 11))
            many_points(page, session, server, points)
        finally:
            browser.close()
            server.end()


def main() -> None:
    """Measure with a server and a browser of its own."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=int, default=46)
    parser.add_argument("--points", type=int, default=100_000)
    options = parser.parse_args()
    measure(options.side, options.points)


if __name__ == "__main__":
    main()
