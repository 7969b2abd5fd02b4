"""Limits of a request, a study and the queue; ``GET /api/v1/limits`` lists them."""

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Limits:
    """Largest values that the service accepts; `MEANINGS` explains each limit."""

    body_bytes: int = 256 * 1024
    measurement_bytes: int = 16 * 1024 * 1024
    nesting: int = 32
    files: int = 50
    points: int = 200_000
    cube_bytes: int = 4_000_000_000
    cpu_hours: float = 500.0
    queued: int = 100
    running: int = 2
    cells: int = 2_000_000
    answer_bytes: int = 64_000_000
    query_seconds: float = 30.0
    simulate_seconds: float = 300.0
    memory_bytes: int = 8_000_000_000
    run_memory_bytes: int = 16_000_000_000
    streams: int = 1_000
    connections: int = 1_500
    bin_days: float = 30.0

    def described(self) -> list[dict[str, Any]]:
        """All limits with their meanings, for programs and for the page."""
        return [{"name": name, "value": value, "meaning": MEANINGS[name]} for name, value in asdict(self).items()]


MEANINGS = {
    "body_bytes": "size of a request's body, .csv and .txt files of an upload left out (bytes)",
    "measurement_bytes": "size of a request's body with tables or measurements (bytes)",
    "nesting": "depth of brackets within each other in a request's JSON",
    "files": "number of files uploaded with a study or a workflow",
    "points": "points of a study, of all studies of a workflow together, of a fit or an optimisation",
    "cube_bytes": "size of the cube of a study (bytes)",
    "cpu_hours": "price of a study by its timed or recorded points (CPU-hours)",
    "queued": "runs that wait in the queue",
    "running": "runs at work at the same time",
    "cells": "cells in the answer to a query",
    "answer_bytes": "size of the answer to a query (bytes)",
    "query_seconds": "CPU time for the answer to a query, a comparison or a check (s)",
    "simulate_seconds": "CPU time for one simulated point, or for a plan with timing (s)",
    "memory_bytes": "address space of a worker (bytes)",
    "run_memory_bytes": "address space of each process of a run (bytes)",
    "streams": "event streams open at the same time",
    "connections": "connections open at the same time; fewer where the system allows fewer open files",
    "bin_days": "days after which a deleted run is removed from the bin, once a server has run for an hour",
}
"""Meaning of each limit."""
