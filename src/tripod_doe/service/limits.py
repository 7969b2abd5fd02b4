"""Limits of a request, a study and the queue; ``GET /api/v1/limits`` lists them."""

from dataclasses import dataclass, field, fields
from typing import Any


def _limit(value: Any, meaning: str) -> Any:
    return field(default=value, metadata={"meaning": meaning})


@dataclass(frozen=True)
class Limits:
    """Largest values that the service accepts."""

    body_bytes: int = _limit(256 * 1024, "size of a request's body, .csv and .txt files of an upload left out (bytes)")
    measurement_bytes: int = _limit(16 * 1024 * 1024, "size of a request's body with tables or measurements (bytes)")
    nesting: int = _limit(32, "depth of brackets within each other in a request's JSON")
    files: int = _limit(50, "number of files uploaded with a study or a workflow")
    points: int = _limit(
        200_000, "points of a study, of all studies of a workflow together, of a fit or an optimisation"
    )
    cube_bytes: int = _limit(4_000_000_000, "size of the cube of a study (bytes)")
    cpu_hours: float = _limit(500.0, "price of a study by its timed or recorded points (CPU-hours)")
    queued: int = _limit(100, "runs that wait in the queue")
    running: int = _limit(2, "runs at work at the same time")
    cells: int = _limit(2_000_000, "cells in the answer to a query")
    answer_bytes: int = _limit(64_000_000, "size of the answer to a query (bytes)")
    query_seconds: float = _limit(30.0, "CPU time for the answer to a query, a comparison or a check (s)")
    simulate_seconds: float = _limit(300.0, "CPU time for one simulated point, or for a plan with timing (s)")
    memory_bytes: int = _limit(8_000_000_000, "address space of a worker (bytes)")
    run_memory_bytes: int = _limit(16_000_000_000, "address space of each process of a run (bytes)")
    streams: int = _limit(1_000, "event streams open at the same time")
    connections: int = _limit(
        1_500, "connections open at the same time; fewer where the system allows fewer open files"
    )
    bin_days: float = _limit(
        30.0, "days after which a deleted run is removed from the bin, once a server has run for an hour"
    )

    def described(self) -> list[dict[str, Any]]:
        """All limits with their meanings, for programs and for the page."""
        return [
            {"name": each.name, "value": getattr(self, each.name), "meaning": each.metadata["meaning"]}
            for each in fields(self)
        ]
