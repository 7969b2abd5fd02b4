"""Workers that are none: they stand for Dask's, are ready when they are told to be, and compute in this process."""

from __future__ import annotations

from dataclasses import replace

from tripod_doe.study.execution.this_process import ThisProcess


class OtherProcess(ThisProcess):
    """Stands for a worker process."""

    def next_finished(self):
        block, answer = super().next_finished()
        return block, replace(answer, worker="worker")


class SlowStart:
    """Workers that are ready when they have been looked at so many times."""

    looks = 2
    started = 0

    def __init__(self, count, scheduler):
        self.count, self.scheduler, self.left = count, scheduler, self.looks
        SlowStart.started += 1

    def start(self, study):
        pass

    @property
    def ready(self):
        self.left -= 1
        return self.left < 0

    def executor(self, study):
        return OtherProcess()

    def close(self):
        pass
