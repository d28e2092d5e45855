"""Calls in processes of this machine, or by whatever runs them elsewhere."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, as_completed, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing import get_context
from typing import Any

#: A function and its arguments.
Call = tuple[Any, ...]
Keep = Callable[[int, Any], None]
Fail = Callable[[int, str], None]


def by_processes(calls: dict[int, Call], jobs: int | None, keep: Keep, fail: Fail) -> None:
    """Makes calls in processes of this machine.

    One that is killed takes its whole pool down, and nothing tells which call it had: those that were at hand are made
    again, each alone.
    """
    left = dict(calls)
    while left:
        at_hand = _until_killed(left, (os.cpu_count() or 1) if jobs is None else jobs, keep, fail)
        # Where not even this can be called, a process for each of the others would end no better.
        if at_hand and _until_killed({0: (int,)}, 1, lambda i, zero: None, fail):
            for i in [*at_hand, *left]:
                fail(i, "BrokenProcessPool: no process begins, as of a script without `if __name__ == '__main__':`")
            return
        for i in at_hand:
            if _until_killed({i: calls[i]}, 1, keep, fail):
                fail(i, "BrokenProcessPool: its process was killed, as where memory runs out, or crashed")


def _until_killed(left: dict[int, Call], jobs: int, keep: Keep, fail: Fail) -> list[int]:
    """Takes calls from `left` and makes them, so many at a time, until a process is killed; gives those at hand then."""
    at_hand: dict[Future[Any], int] = {}

    def take(futures: Iterable[Future[Any]]) -> None:
        for future in futures:
            if not isinstance(future.exception(), BrokenProcessPool):
                _take(at_hand.pop(future), future, keep, fail)

    # A pool may also break between two results, which its next `submit` tells.
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool, suppress(BrokenProcessPool):
        done: Collection[Future[Any]] = ()
        while (left or at_hand) and not at_hand.keys() & done:
            while left and len(at_hand) < jobs:
                i = next(iter(left))
                at_hand[pool.submit(*left[i])] = i
                del left[i]
            done = wait(at_hand, return_when=FIRST_COMPLETED).done
            take(done)
    take(list(at_hand))
    return list(at_hand.values())


def wait_for(tasks: Mapping[int, Any], keep: Keep, fail: Fail) -> None:
    """Takes results as they come."""
    numbers = {future: i for i, future in tasks.items()}
    if all(isinstance(future, Future) for future in numbers):
        done: Iterable[Any] = as_completed(numbers)
    else:
        from dask.distributed import as_completed as dask_as_completed

        done = dask_as_completed(numbers)
    for future in done:
        _take(numbers[future], future, keep, fail)


def _take(i: int, future: Any, keep: Keep, fail: Fail) -> None:
    """Takes a result, or what was raised instead."""
    try:
        keep(i, future.result())
    except (Exception, SystemExit) as error:
        # The measure of one point may end its process, not the study.
        fail(i, f"{type(error).__name__}: {error}")
