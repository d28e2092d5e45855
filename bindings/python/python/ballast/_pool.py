"""Calls in worker processes of this machine (loky), or by an executor. Errors of calls come back as text."""

from __future__ import annotations

import os
import pickle
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, as_completed, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, redirect_stderr, suppress
from typing import Any

#: A function and its arguments.
Call = tuple[Any, ...]
#: Receives the number of a call and its result.
OnResult = Callable[[int, Any], None]
#: Receives the number of a call and its error.
OnError = Callable[[int, str], None]

_PACKAGE = os.path.join(os.path.dirname(__file__), "")


def check_picklable(measure: Callable[..., Any]) -> None:
    """Raises TypeError if a function cannot be sent to worker processes.

    Functions of a notebook or script are sent by value, functions of modules by name.
    """
    import cloudpickle

    try:
        cloudpickle.dumps(measure)
    except Exception as error:
        raise TypeError(
            f"measure: expected a function that can be sent to other processes, found {measure!r} ({_described(error)}); "
            "avoid the object that cannot be pickled, or pass `executor=`"
        ) from None


def run_in_processes(calls: Mapping[int, Call], jobs: int | None, on_result: OnResult, on_error: OnError) -> None:
    """Runs calls in worker processes.

    A killed process breaks its pool, and the call that it ran is unknown. All running calls are then repeated one by one;
    only one whose process is killed again fails.
    """
    import cloudpickle

    pickled = {i: cloudpickle.dumps(call) for i, call in calls.items()}
    waiting = dict(pickled)
    with ExitStack() as stack:
        if sys.stderr is None or sys.stderr.closed:
            # loky flushes stderr before it starts a process.
            stack.enter_context(redirect_stderr(stack.enter_context(open(os.devnull, "w"))))
        while waiting:
            for i in _run_pool(waiting, jobs or os.cpu_count() or 1, on_result, on_error):
                if _run_pool({i: pickled[i]}, 1, on_result, on_error):
                    on_error(i, "BrokenProcessPool: its process was killed, for example out of memory, or crashed")


def _run_pool(waiting: dict[int, bytes], jobs: int, on_result: OnResult, on_error: OnError) -> list[int]:
    """Runs calls of `waiting` until none is left or a process is killed; returns the numbers of those running then."""
    from loky import ProcessPoolExecutor

    running: dict[Future[Any], int] = {}

    def take(futures: Iterable[Future[Any]]) -> None:
        for future in futures:
            if not isinstance(future.exception(), BrokenProcessPool):
                _take(running[future], future, on_result, on_error)
                # After the result is kept, so that Ctrl-C loses none.
                del running[future]

    pool = ProcessPoolExecutor(min(jobs, len(waiting)), initializer=_start_worker, initargs=(os.getpid(),))
    try:
        # `submit` raises if the pool broke since the last result.
        with suppress(BrokenProcessPool):
            while waiting or running:
                while waiting and len(running) < jobs:
                    i = next(iter(waiting))
                    running[pool.submit(_call_pickled, waiting[i])] = i
                    del waiting[i]
                done = wait(running, return_when=FIRST_COMPLETED).done
                take(done)
                if not running.keys().isdisjoint(done):
                    break
        # A broken pool completes all futures.
        take(list(running))
    except BaseException:
        take([future for future in running if future.done() and future.exception() is None])
        raise
    finally:
        pool.shutdown(kill_workers=True)
    return list(running.values())


def _start_worker(parent: int) -> None:
    """Prepares a worker process: it ends with its parent, and leaves Ctrl-C to it."""

    def watch_parent() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch_parent, daemon=True).start()
    # A handler instead of SIG_IGN, which programs started by a measure would inherit.
    signal.signal(signal.SIGINT, lambda *_: None)


def wait_for(futures: Mapping[int, Any], on_result: OnResult, on_error: OnError) -> None:
    """Takes the results of an executor's futures as they complete."""
    numbers = {future: i for i, future in futures.items()}
    if all(isinstance(future, Future) for future in numbers):
        done: Iterable[Any] = as_completed(numbers)
    else:
        from dask.distributed import as_completed as dask_as_completed

        done = dask_as_completed(numbers)
    try:
        for future in done:
            _take(numbers[future], future, on_result, on_error)
    finally:
        # After an exception such as Ctrl-C, calls that have not started are cancelled.
        for future in numbers:
            if not future.done():
                future.cancel()


def _take(i: int, future: Any, on_result: OnResult, on_error: OnError) -> None:
    try:
        result, error = future.result()
        if error is None:
            on_result(i, result)
    except Exception as exception:
        error = _described(exception)
    if error is not None:
        on_error(i, error)


def call_safely(function: Callable[..., Any], *arguments: Any) -> tuple[Any, str | None]:
    """Returns the result of a call, or its exception as text: other processes may be unable to unpickle the exception."""
    try:
        return function(*arguments), None
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        # SystemExit of a measure ends its point, not the study.
        return None, _described(error) + _location(error)


def _call_pickled(pickled: bytes) -> tuple[Any, str | None]:
    """Unpickles and runs a call; an error of unpickling would break the pool if the pool did it."""

    def call() -> Any:
        function, *arguments = pickle.loads(pickled)
        return function(*arguments)

    return call_safely(call)


def _described(error: BaseException) -> str:
    try:
        return f"{type(error).__name__}: {error}"
    except Exception:
        return f"{type(error).__name__} (its message cannot be formatted)"


def _location(error: BaseException) -> str:
    """Returns the innermost source line of an exception outside of this package, as a suffix of its message."""
    for frame, line in reversed([*traceback.walk_tb(error.__traceback__)]):
        code = frame.f_code
        if not code.co_filename.startswith(_PACKAGE):
            return f" ({os.path.basename(code.co_filename)}:{line}, in {code.co_name})"
    return ""
