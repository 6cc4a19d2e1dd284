"""Processes imitated by threads: what needs no PETSc is tested everywhere, on several of them."""

import threading
from collections.abc import Callable
from typing import Any


class ThreadCommunicator:
    """The communicator of one of several threads."""

    def __init__(self, rank: int, boxes: list[Any], barrier: threading.Barrier) -> None:
        self.rank, self.size = rank, len(boxes)
        self._boxes, self._barrier = boxes, barrier

    def allgather(self, sendobj: Any) -> list[Any]:
        self._boxes[self.rank] = sendobj
        self._barrier.wait()
        found = list(self._boxes)
        self._barrier.wait()
        return found

    def alltoall(self, sendobj: list[Any]) -> list[Any]:
        return [each[self.rank] for each in self.allgather(sendobj)]

    def bcast(self, obj: Any, root: int = 0) -> Any:
        return self.allgather(obj)[root]

    def gather(self, sendobj: Any, root: int = 0) -> list[Any] | None:
        found = self.allgather(sendobj)
        return found if self.rank == root else None

    def scatter(self, sendobj: Any, root: int = 0) -> Any:
        return self.allgather(sendobj)[root][self.rank]


def on_threads(size: int, task: Callable[[Any], Any]) -> list[Any]:
    """What a task returns on each of several communicators; the first error, if there is one."""
    boxes: list[Any] = [None] * size
    barrier = threading.Barrier(size)
    found: list[Any] = [None] * size
    errors: list[BaseException | None] = [None] * size

    def run(rank: int) -> None:
        try:
            found[rank] = task(ThreadCommunicator(rank, boxes, barrier))
        except BaseException as error:
            errors[rank] = error
            barrier.abort()

    threads = [threading.Thread(target=run, args=(rank,)) for rank in range(size)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    real = [e for e in errors if e and not isinstance(e, threading.BrokenBarrierError)]
    if real:
        raise real[0]
    return found
