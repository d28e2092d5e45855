"""Values as JSON, numpy's among them."""

from __future__ import annotations

import json
from typing import Any

import numpy as np


def dumps(value: Any, **style: Any) -> str:
    return json.dumps(value, default=_plain, **style)


def _plain(value: Any) -> Any:
    """Numbers and arrays of numpy as those of Python."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    kind = type(value).__name__
    raise TypeError(f"expected texts, numbers, truths, and lists and dictionaries of these, found {value!r} ({kind})")
