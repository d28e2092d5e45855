"""Calls in processes of this machine, or by whatever runs them elsewhere. What they raise comes back in words."""

from __future__ import annotations

import os
import pickle
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Collection, Iterable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, as_completed, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

from ballast import _identity

#: A function and its arguments.
Call = tuple[Any, ...]
Keep = Callable[[int, Any], None]
Fail = Callable[[int, str], None]

_PACKAGE = os.path.join(os.path.dirname(__file__), "")


def check(measure: Callable[..., Any]) -> None:
    """Tells of a measure that other processes cannot find, before any of them ends at it."""
    advice = "put it in a module, or pass `executor=`"
    inner = _identity.inner(measure)
    if getattr(inner, "__module__", None) == "__main__" and not _main_is_read_again():
        raise TypeError(
            f"measure: expected a function of a module, which other processes read, found {inner!r} of a notebook or a "
            f"prompt; {advice}"
        )
    try:
        pickle.dumps(measure)
    except Exception as error:
        raise TypeError(
            f"measure: expected a function that can be sent to other processes, found {inner!r} ({_told(error)}); {advice}"
        ) from None


def _main_is_read_again() -> bool:
    """Whether processes that begin read what this one has begun with: a script or a module."""
    main = sys.modules["__main__"]
    return getattr(main, "__spec__", None) is not None or os.path.isfile(getattr(main, "__file__", None) or "")


def by_processes(calls: dict[int, Call], jobs: int | None, keep: Keep, fail: Fail) -> None:
    """Makes calls in processes of this machine.

    One that is killed takes its whole pool down, and nothing tells which call it had: those that were at hand are made
    again, each alone.
    """
    sent = {i: pickle.dumps(call) for i, call in calls.items()}
    left = dict(sent)
    while left:
        at_hand = _until_killed(left, (os.cpu_count() or 1) if jobs is None else jobs, keep, fail)
        # Where not even this can be called, a process for each of the others would end no better.
        if at_hand and _until_killed({0: pickle.dumps((int,))}, 1, lambda i, zero: None, fail):
            for i in [*at_hand, *left]:
                fail(i, "BrokenProcessPool: no process begins, as of a script without `if __name__ == '__main__':`")
            return
        for i in at_hand:
            if _until_killed({i: sent[i]}, 1, keep, fail):
                fail(i, "BrokenProcessPool: its process was killed, as where memory runs out, or crashed")


def _until_killed(left: dict[int, bytes], jobs: int, keep: Keep, fail: Fail) -> list[int]:
    """Takes calls from `left` and makes them, so many at a time, until a process is killed; gives those at hand then."""
    at_hand: dict[Future[Any], int] = {}

    def take(futures: Iterable[Future[Any]]) -> None:
        for future in futures:
            if not isinstance(future.exception(), BrokenProcessPool):
                _take(at_hand[future], future, keep, fail)
                # Not before: what Ctrl-C keeps from being taken is taken after it.
                del at_hand[future]

    context = get_context("spawn")
    watched, held = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_end_with, initargs=(watched,))
    try:
        # A pool may also break between two results, which its next `submit` tells.
        with suppress(BrokenProcessPool):
            done: Collection[Future[Any]] = ()
            while (left or at_hand) and not at_hand.keys() & done:
                while left and len(at_hand) < jobs:
                    i = next(iter(left))
                    at_hand[pool.submit(_tried_as_sent, left[i])] = i
                    del left[i]
                done = wait(at_hand, return_when=FIRST_COMPLETED).done
                take(done)
    except BaseException:
        # Ctrl-C, or a line that cannot be printed: nobody waits for what is being computed.
        held.close()
        take([future for future in at_hand if future.done() and future.exception() is None])
        raise
    finally:
        pool.shutdown(cancel_futures=True)
        held.close()
        watched.close()
    take(list(at_hand))
    return list(at_hand.values())


def _end_with(watched: Connection) -> None:
    """Lets a process of a pool end, whatever it computes, as soon as the other end of `watched` is closed: by what began it,
    or because that has ended, however it has. Nothing else would tell the process: it would wait for calls for ever."""

    def end() -> None:
        with suppress(OSError):
            watched.poll(None)
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()
    # Ctrl-C is for what began it. Not ignored, as programs that a measure starts would then ignore it, too.
    signal.signal(signal.SIGINT, lambda *_: None)


def wait_for(tasks: Mapping[int, Any], keep: Keep, fail: Fail) -> None:
    """Takes results as they come."""
    numbers = {future: i for i, future in tasks.items()}
    if all(isinstance(future, Future) for future in numbers):
        done: Iterable[Any] = as_completed(numbers)
    else:
        from dask.distributed import as_completed as dask_as_completed

        done = dask_as_completed(numbers)
    try:
        for future in done:
            _take(numbers[future], future, keep, fail)
    finally:
        # After Ctrl-C, what has not begun need not begin.
        for future in numbers:
            if not future.done():
                future.cancel()


def _take(i: int, future: Any, keep: Keep, fail: Fail) -> None:
    """Takes what came of a call."""
    try:
        result, failure = future.result()
        if failure is None:
            keep(i, result)
    except Exception as error:
        failure = _told(error)
    if failure is not None:
        fail(i, failure)


def tried(function: Callable[..., Any], *arguments: Any) -> tuple[Any, str | None]:
    """The result of a call, or in words what it has raised: an exception may be none that another process can read."""
    try:
        return function(*arguments), None
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        # The measure of one point may end its process, not the study.
        return None, _told(error) + _place(error)


def _tried_as_sent(sent: bytes) -> tuple[Any, str | None]:
    """The same of a call that is read here: a pool breaks where it cannot read one itself."""

    def call() -> Any:
        function, *arguments = pickle.loads(sent)
        return function(*arguments)

    return tried(call)


def _told(error: BaseException) -> str:
    """An exception in words."""
    try:
        return f"{type(error).__name__}: {error}"
    except Exception:
        return f"{type(error).__name__}, whose message cannot be told"


def _place(error: BaseException) -> str:
    """The last place outside of this package that an exception has come through, if there is one."""
    for frame, line in reversed([*traceback.walk_tb(error.__traceback__)]):
        code = frame.f_code
        if not code.co_filename.startswith(_PACKAGE):
            return f" ({os.path.basename(code.co_filename)}:{line}, in {code.co_name})"
    return ""
