"""How long the owner waits while strangers without a token flood the server with requests.

    python benchmarks/service_flood.py [--clients 900] [--seconds 15] [--only health]

Each stranger sends its next request as soon as the last one is answered: over a connection that it keeps, or over a new
one each time. The owner asks for the list of runs, over a new connection each time, as a page does that is opened.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import resource
import tempfile
import time
from pathlib import Path
from typing import Any

from service_load import Server, answer

FLOODS = {"health": "/api/v1/health", "refused": "/api/v1/runs", "page": "/", "assets": "/assets/page.css"}


class Stranger(asyncio.Protocol):
    """One connection that asks again with each answer."""

    def __init__(self, request: bytes, keep: bool, again: asyncio.Queue[None], answers: Any) -> None:
        self._request, self._keep, self._again, self._answers = request, keep, again, answers

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Ask."""
        self._transport = transport
        transport.write(self._request)

    def data_received(self, data: bytes) -> None:
        """Ask again."""
        self._answers.value += 1
        if self._keep:
            self._transport.write(self._request)
        else:
            self._transport.close()

    def connection_lost(self, exc: Exception | None) -> None:
        """Have another connection opened."""
        self._again.put_nowait(None)


def flood(port: int, path: str, clients: int, keep: bool, answers: Any) -> None:
    """Flood a server until this process is ended, and count the answers."""
    request = f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode()

    async def run() -> None:
        again: asyncio.Queue[None] = asyncio.Queue()
        for _ in range(clients):
            again.put_nowait(None)

        async def connect() -> None:
            while True:
                await again.get()
                try:
                    loop = asyncio.get_running_loop()
                    await loop.create_connection(lambda: Stranger(request, keep, again, answers), "127.0.0.1", port)
                except OSError:
                    again.put_nowait(None)
                    await asyncio.sleep(0.01)

        await asyncio.gather(*(connect() for _ in range(clients)))

    resource.setrlimit(resource.RLIMIT_NOFILE, (4096, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
    asyncio.run(run())


async def waits(server: Server, seconds: float) -> list[float]:
    """Seconds that each answer to the owner took, for some time; a last one is waited for."""
    waited, began = [], time.perf_counter()
    while time.perf_counter() < began + seconds:
        started = time.perf_counter()
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        writer.write(server.head("GET", "/runs"))
        status, _ = await answer(reader)
        writer.close()
        waited.append(time.perf_counter() - started if status == 200 else float("inf"))
        await asyncio.sleep(0.2)
    return waited


def main() -> None:
    """Print, for each kind of flood, the owner's waits."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--clients", type=int, default=900)
    parser.add_argument("--seconds", type=float, default=15.0)
    parser.add_argument("--only", choices=FLOODS, nargs="+", default=list(FLOODS))
    options = parser.parse_args()
    for name in options.only:
        path = FLOODS[name]
        for keep in (True, False):
            with tempfile.TemporaryDirectory() as folder:
                server = Server(Path(folder))
                context = multiprocessing.get_context("spawn")
                answers = context.Value("q", 0, lock=False)
                words = (server.port, path, options.clients, keep, answers)
                strangers = context.Process(target=flood, args=words, daemon=True)
                try:
                    asyncio.run(waits(server, 1.0))
                    strangers.start()
                    while answers.value < options.clients:
                        time.sleep(0.1)
                    before = answers.value
                    waited = sorted(asyncio.run(waits(server, options.seconds)))
                finally:
                    strangers.kill()
                    server.end()
            result = {
                "flood": name,
                "kept": keep,
                "strangers_per_s": (answers.value - before) / options.seconds,
                "answers": len(waited),
            }
            print(json.dumps(result | {"median_s": waited[len(waited) // 2], "longest_s": waited[-1]}), flush=True)


if __name__ == "__main__":
    main()
