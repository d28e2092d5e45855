"""Progress of a preparation: a tqdm bar if tqdm is installed, else a line per ten per cent on stderr."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

#: Callback with a fraction from 0 to 1 and a text.
ProgressCallback = Callable[[float, str], object]


def show(text: str) -> None:
    """Prints a line on stderr; a closed or missing stderr is ignored."""
    with suppress(OSError, ValueError, AttributeError):
        print(text, file=sys.stderr, flush=True)


@contextmanager
def progress_callback(choice: bool | ProgressCallback, title: str) -> Iterator[ProgressCallback | None]:
    """Provides the callback for a choice: True shows progress, False does not, a callback is used as it is."""
    if choice is not True:
        yield None if choice is False else choice
        return
    display = _Display(title)
    try:
        yield display.update
        display.finish()
    finally:
        display.close()


class _Display:
    """Display of a fraction on stderr, which never raises."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._bar: Any = None
        self._percent = -1

    def update(self, fraction: float, text: str) -> None:
        percent = int(100 * fraction)
        if self._percent < 0:
            self._bar = _tqdm_bar(self._title)
        if self._bar is not None:
            self._draw(percent, text)
        elif percent // 10 > self._percent // 10:
            show(f"{self._title}: {percent} % ({text})")
        self._percent = max(self._percent, percent, 0)

    def finish(self) -> None:
        if self._bar is not None:
            self._draw(100, "")

    def close(self) -> None:
        if self._bar is not None:
            with suppress(OSError, ValueError):
                self._bar.close()

    def _draw(self, percent: int, text: str) -> None:
        with suppress(OSError, ValueError):
            if text:
                self._bar.set_postfix_str(text, refresh=False)
            self._bar.update(percent - self._bar.n)


def _tqdm_bar(title: str) -> Any:
    try:
        from tqdm.auto import tqdm
    except ImportError:
        return None
    with suppress(OSError, ValueError, AttributeError):
        return tqdm(total=100, desc=title, unit="%")
    return None
