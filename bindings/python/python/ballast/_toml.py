"""Values as TOML, numpy's among them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np


def dumps(values: Mapping[str, Any]) -> str:
    """A table, a line for each key."""
    return "".join(f"{value_of(str(key))} = {value_of(value, str(key))}\n" for key, value in values.items())


def value_of(value: Any, place: str = "") -> str:
    """One value; `place` is where it stands, for messages."""
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, bool | str):
        # Texts of JSON are those of TOML, but for one character that TOML wants escaped.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, Mapping):
        inside = (f"{value_of(str(key))} = {value_of(inner, f'{place}.{key}')}" for key, inner in value.items())
        return f"{{ {', '.join(inside)} }}"
    # A set has no order, and no one means a list by bytes.
    if isinstance(value, Iterable) and not isinstance(value, set | frozenset | bytes | bytearray | memoryview):
        return f"[{', '.join(value_of(inner, place) for inner in value)}]"
    kind = type(value).__name__
    raise TypeError(f"{place}: expected texts, numbers, truths, and lists and dictionaries of these, found {value!r} ({kind})")
