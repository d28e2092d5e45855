"""Values as JSON, numpy's among them."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np


def dumps(value: Any, **style: Any) -> str:
    return json.dumps(value, default=_plain, **style)


def strict(value: Any) -> Any:
    """The same value with texts ("nan", "inf", "-inf") for numbers that are not finite, which JSON does not know."""
    if isinstance(value, float | np.floating) and not math.isfinite(value):
        return str(float(value))
    if isinstance(value, dict):
        return {key: strict(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [strict(inner) for inner in value]
    return value


def _plain(value: Any) -> Any:
    """Numbers and arrays of numpy as those of Python."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    kind = type(value).__name__
    raise TypeError(f"expected texts, numbers, truths, and lists and dictionaries of these, found {value!r} ({kind})")
