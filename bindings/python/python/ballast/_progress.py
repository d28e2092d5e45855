"""How far a preparation is: a bar of tqdm where that is installed, else a line every ten per cent."""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import TracebackType
from typing import Any

OnProgress = Callable[[float, str], object]


class Progress:
    """Shows the share of some work that is done; as a context, gives the function that is to be told."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._bar: Any = None
        self._shown = -1

    @staticmethod
    def of(choice: bool | OnProgress, title: str) -> Progress | _Told:
        """What the caller chose: shown, not shown, or told to a function of the caller's."""
        if choice is True:
            return Progress(title)
        return _Told(None if choice is False else choice)

    def __enter__(self) -> OnProgress:
        return self._tell

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._bar is not None:
            if error is None:
                self._bar.update(100 - self._bar.n)
            self._bar.close()

    def _tell(self, share: float, text: str) -> None:
        percent = int(100 * share)
        if self._shown < 0:
            self._bar = _bar(self._title)
        if self._bar is not None:
            self._bar.set_postfix_str(text, refresh=False)
            self._bar.update(percent - self._bar.n)
        elif percent // 10 > self._shown // 10:
            print(f"{self._title}: {percent} % ({text})", file=sys.stderr, flush=True)
        self._shown = max(self._shown, percent, 0)


class _Told:
    """A function of the caller's, or none."""

    def __init__(self, tell: OnProgress | None) -> None:
        self._tell = tell

    def __enter__(self) -> OnProgress | None:
        return self._tell

    def __exit__(self, *_: object) -> None:
        pass


def _bar(title: str) -> Any:
    try:
        from tqdm.auto import tqdm
    except ImportError:
        return None
    return tqdm(total=100, desc=title, unit="%")
