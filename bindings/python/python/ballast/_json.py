"""JSON with numpy scalars and arrays."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np


def dumps(value: Any, **style: Any) -> str:
    """Returns a value as JSON; `style` holds options of `json.dumps`."""
    return json.dumps(value, default=_to_python, **style)


def with_text_for_nonfinite(value: Any) -> Any:
    """Returns a value with "nan", "inf" and "-inf" for numbers that JSON cannot hold."""
    if isinstance(value, float | np.floating) and not math.isfinite(value):
        return str(float(value))
    if isinstance(value, dict):
        return {key: with_text_for_nonfinite(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [with_text_for_nonfinite(item) for item in value]
    return value


def _to_python(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    kind = type(value).__name__
    raise TypeError(f"expected a string, number, boolean, list or dictionary, found {value!r} ({kind})")
