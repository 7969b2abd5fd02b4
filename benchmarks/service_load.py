"""What the service costs: small answers per second, a slice of a cube, 200 event streams, memory, price of watchers.

    python benchmarks/service_load.py [--requests 5000] [--memory 100000] [--watchers 20] [--side 40]

It starts a server on a folder of its own, with the demonstration study. Rates are of one connection per client with
pipelining off; on a busy machine only CPU times and the counted parts (bytes, events, growth of memory) say anything.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil

LONG = """
[study]
name = "watched"
[base]
model = "equilibrium"
[factors.joint_angle_deg]
low = 2
high = 18
count = {count}
[factors.torque_n_m]
low = 20
high = 300
count = {count}
[keep]
outputs = ["thrust_rms"]
[run]
block = 20
"""


class Server:
    """A server on a folder of its own."""

    def __init__(self, folder: Path, *flags: str) -> None:
        words = [sys.executable, "-m", "tripod_doe.cli", "serve", "--folder", str(folder), "--port", "0", *flags]
        self.process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        found = re.fullmatch(r"http://127\.0\.0\.1:(\d+)/\?token=(\S+)\n", self.process.stdout.readline())
        self.port, self.token = int(found[1]), found[2]

    def head(self, method: str, path: str, body: bytes = b"") -> bytes:
        """A request as bytes."""
        lines = [
            f"{method} /api/v1{path} HTTP/1.1",
            f"Host: 127.0.0.1:{self.port}",
            f"Authorization: Bearer {self.token}",
        ]
        lines += ["Content-Type: application/json", f"Content-Length: {len(body)}"] if body else []
        return "\r\n".join([*lines, "", ""]).encode() + body

    def end(self) -> None:
        """End it."""
        self.process.terminate()
        self.process.wait()
        self.process.stdout.close()


async def answer(reader: asyncio.StreamReader) -> tuple[int, bytes]:
    """Status and body of an answer with a known length."""
    head = (await reader.readuntil(b"\r\n\r\n")).decode("latin-1").lower()
    length = re.search(r"content-length: (\d+)", head)
    return int(head.split()[1]), await reader.readexactly(int(length[1]) if length else 0)


async def asked(server: Server, request: bytes, count: int, clients: int) -> np.ndarray:
    """Seconds of each of `count` equal requests over some connections side by side."""
    seconds: list[float] = []

    async def client(share: int) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        for _ in range(share):
            started = time.perf_counter()
            writer.write(request)
            status, _ = await answer(reader)
            assert status == 200, status
            seconds.append(time.perf_counter() - started)
        writer.close()

    await asyncio.gather(*(client(count // clients) for _ in range(clients)))
    return np.array(seconds)


async def once(server: Server, method: str, path: str, body: object = None) -> object:
    """One request, and its JSON."""
    reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
    writer.write(server.head(method, path, b"" if body is None else json.dumps(body).encode()))
    status, data = await answer(reader)
    writer.close()
    assert status < 300, (status, data[:300])
    return json.loads(data) if data else None


async def events(server: Server, streams: int, run_id: str, until: str) -> list[dict[str, float]]:
    """Events that each of some streams saw of a run until it was in a state: the moment at which each came, by name."""

    async def watch() -> dict[str, float]:
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        writer.write(server.head("GET", f"/runs/{run_id}/events"))
        seen, state = {}, ""
        while line := await reader.readline():
            if line.startswith(b"data: "):
                state = json.loads(line[6:])["state"]
            if line.startswith(b"id: "):
                seen[line.decode().strip()] = time.perf_counter()
                if state == until:
                    break
        writer.close()
        return seen

    return list(await asyncio.gather(*(watch() for _ in range(streams))))


async def finished(server: Server, run_id: str) -> dict:
    """A run when it is at rest."""
    while (run := await once(server, "GET", f"/runs/{run_id}"))["state"] not in ("finished", "failed", "stopped"):
        await asyncio.sleep(0.2)
    return run


async def paced(server: Server, request: bytes, rate: float, seconds: float, clients: int = 8) -> np.ndarray:
    """Seconds from the moment at which each request was due, at a fixed rate, to its answer."""
    due = time.perf_counter() + np.arange(int(rate * seconds)) / rate
    found: list[float] = []

    async def client(own: np.ndarray) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        for moment in own:
            await asyncio.sleep(max(0.0, moment - time.perf_counter()))
            writer.write(request)
            await answer(reader)
            found.append(time.perf_counter() - moment)
        writer.close()

    await asyncio.gather(*(client(due[at::clients]) for at in range(clients)))
    return np.array(found)


def cpu_of(server: Server) -> float:
    """CPU seconds of the server's own process."""
    used = psutil.Process(server.process.pid).cpu_times()
    return used.user + used.system


async def measure(server: Server, requests: int, memory: int, watchers: int, side: int = 40, turns: int = 3) -> None:
    """Measure on a server with one finished run, and print a line for each figure."""
    while not (runs := await once(server, "GET", "/runs")):  # until it has been found
        await asyncio.sleep(0.1)
    (demo,) = runs
    small = server.head("GET", f"/runs/{demo['id']}")
    await asked(server, small, 200, 1)
    for clients in (1, 8):
        cpu, started = cpu_of(server), time.perf_counter()
        seconds = await asked(server, small, requests, clients)
        cpu, rate = cpu_of(server) - cpu, seconds.size / (time.perf_counter() - started)
        print(
            f"small answers, {clients} clients: {rate:.0f} per second, p99 {1e3 * np.quantile(seconds, 0.99):.1f} ms, "
            f"{1e6 * cpu / seconds.size:.0f} us of CPU time each: at most {seconds.size / max(cpu, 0.01):.0f} per second"
        )
    question = f"/runs/{demo['id']}/query?variable=thrust_rms"
    cells = len(await once(server, "GET", question))
    query = server.head("GET", question)
    await asked(server, query, 5, 1)
    seconds = await asked(server, query, 50, 1)
    print(f"slice of {cells:,} cells as JSON: median {1e3 * np.median(seconds):.0f} ms")
    before = psutil.Process(server.process.pid).memory_info().rss
    await asked(server, small, memory, 8)
    growth = psutil.Process(server.process.pid).memory_info().rss / before - 1
    print(f"memory after {memory:,} requests: {100 * growth:+.1f} % of {before / 1e6:.0f} MB")
    await watch_figures(server, watchers, side, turns)
    await beside_studies(server, small, side, min(20.0, requests / 100))


async def beside_studies(server: Server, request: bytes, side: int, seconds: float) -> None:
    """Answers at 200 per second while two studies use both cores."""
    studies = [LONG.format(count=3 * side).replace("low = 2\n", f"low = {2.5 + at / 100}\n") for at in range(2)]
    runs = [await once(server, "POST", "/runs", {"study": study}) for study in studies]
    for run in runs:
        while not (await once(server, "GET", f"/runs/{run['id']}"))["points"]["finished"]:
            await asyncio.sleep(0.1)
    waited = await paced(server, request, 200, seconds)
    print(
        f"200 per second beside two studies: median {1e3 * np.median(waited):.1f} ms, "
        f"p99 {1e3 * np.quantile(waited, 0.99):.1f} ms"
    )
    for run in runs:
        if (await once(server, "GET", f"/runs/{run['id']}"))["state"] == "running":
            await once(server, "POST", f"/runs/{run['id']}/stop")
        await finished(server, run["id"])


async def watch_figures(server: Server, watchers: int, side: int, turns: int) -> None:
    """Price of a study with and without watchers, in turns, and what 200 streams see of one."""
    prices: dict[int, list[float]] = {0: [], watchers: []}
    for turn, count in enumerate([0, watchers] * turns):
        study = LONG.format(count=side).replace("low = 2\n", f"low = {2 + turn / 100}\n")
        run = await once(server, "POST", "/runs", {"study": study})
        before = cpu_of(server)
        seen = await events(server, max(count, 1), run["id"], "finished")
        done = await finished(server, run["id"])
        cpu = cpu_of(server) - before
        prices[count].append((done["cpu_seconds"] + cpu) / done["cpu_seconds"])
        assert len({tuple(stream) for stream in seen}) <= 2, "streams differ"
    for count, ratios in prices.items():
        print(f"{count} watchers: the server adds {100 * (np.median(ratios) - 1):.1f} % to the study's CPU time")
    await stream_figures(server, LONG.format(count=3 * side // 4))


async def stream_figures(server: Server, study: str) -> None:
    """What 200 streams see of a study: events lost, and how long after the first stream each event came."""
    run = await once(server, "POST", "/runs", {"study": study})
    seen = await events(server, 200, run["id"], "finished")
    names = list(max(seen, key=len))
    lost = sum(list(stream) != names[len(names) - len(stream) :] for stream in seen)
    first = {name: min(stream[name] for stream in seen if name in stream) for name in names}
    lags = [moment - first[name] for stream in seen for name, moment in stream.items()]
    print(
        f"200 streams: {lost} lost an event of the {len(names)} that the first saw; "
        f"p99 of an event's lag behind the first stream {1e3 * np.quantile(lags, 0.99):.0f} ms"
    )


def main() -> None:
    """Measure with a server of its own."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--requests", type=int, default=5_000)
    parser.add_argument("--memory", type=int, default=100_000)
    parser.add_argument("--watchers", type=int, default=20)
    parser.add_argument("--side", type=int, default=40, help="points of the watched studies, squared")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        server = Server(Path(folder) / "results", "--demo", "--workers", "0")
        try:
            asyncio.run(measure(server, options.requests, options.memory, options.watchers, options.side))
        finally:
            server.end()


if __name__ == "__main__":
    main()
