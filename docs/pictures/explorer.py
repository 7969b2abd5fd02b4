"""Makes docs/pictures/explorer.png, the first picture of the README: the explorer with the demonstration study.

python docs/pictures/explorer.py
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

from playwright.sync_api import sync_playwright

VIEW = "kind=lines&x=joint_angle_deg&by=torque_n_m&select=groove_sliding_friction=0.05&select=order=3"


def wait_for_demo(address: str, token: str) -> str:
    """The id of the demonstration study, when it has finished."""
    request = urllib.request.Request(f"{address}/api/v1/runs", headers={"authorization": f"Bearer {token}"})
    for _ in range(600):
        with urllib.request.urlopen(request) as answer:
            runs = json.load(answer)
        if runs and runs[0]["state"] == "finished":
            return str(runs[0]["id"])
        time.sleep(0.5)
    raise TimeoutError("the demonstration study has not finished")


def take_picture(output: Path) -> None:
    """Start a server of its own, open the view, and keep what a person sees of it."""
    with tempfile.TemporaryDirectory() as folder:
        words = ["-m", "tripod_doe.cli", "serve", "--demo", "--port", "0", "--folder", folder]
        server = subprocess.Popen([sys.executable, *words], stdout=subprocess.PIPE, text=True)
        try:
            assert server.stdout is not None
            door = server.stdout.readline().strip()
            address, _, token = door.partition("/?token=")
            run = wait_for_demo(address, token)
            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(
                    executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"]
                )
                page = browser.new_page(viewport={"width": 1240, "height": 900})
                page.goto(door)
                page.goto(f"{address}/runs/{run}?{VIEW}")
                page.locator("#figure[data-drawn]").wait_for()
                page.wait_for_timeout(1000)
                page.screenshot(path=output, full_page=True)
                browser.close()
        finally:
            server.terminate()
            server.wait()


if __name__ == "__main__":
    take_picture(Path(__file__).with_name("explorer.png"))
