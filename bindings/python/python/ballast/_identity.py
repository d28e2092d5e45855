"""What the figures of a study's point depend on: the case, the point, and the measure with what it holds."""

from __future__ import annotations

import functools
import hashlib
import inspect
from collections.abc import Callable, Iterable, Mapping
from types import CodeType
from typing import Any

import numpy as np

import ballast
from ballast._json import dumps


def key(case: ballast.Case, bed_key: str, point: Mapping[str, Any], measure: Callable[..., Any]) -> str:
    """What a point's figures depend on, as the name of its file. `bed_key` is that of the point's own bed: it also changes
    where the program has come to prepare another one."""
    # 20 and 20.0 ask for the same.
    values = sorted((name, _whole(value)) for name, value in point.items())
    # As it is pickled: `text` could not hold every seed.
    _, (text, *_) = case.__reduce__()
    named, described = name(measure), _described(measure)
    what = [ballast.__version__, text, case.seed, case.schedule, bed_key, values, named, described]
    try:
        return _digest(what)
    except (TypeError, ValueError) as error:
        raise TypeError(
            f"point {dict(point)} of measure {described[0]}: its values, and those that the measure is bound to or takes "
            f"from around it, name its file, and one of them cannot: {error}"
        ) from None


def name(measure: Callable[..., Any]) -> str:
    """A measure as readers know it."""
    function = _functions(inner(measure))[-1]
    return f"{function.__module__}.{function.__qualname__}"


def inner(measure: Any) -> Any:
    """What `functools.partial` binds values to."""
    while isinstance(measure, functools.partial):
        measure = measure.func
    return measure


def code(measure: Callable[..., Any]) -> str:
    """What a measure does, as it is loaded here: its file may be another one by now. Alike in all processes of one Python,
    whatever name its module has there."""
    return _digest(_described(measure))


def _digest(what: list[Any]) -> str:
    return hashlib.sha256(dumps(what).encode()).hexdigest()[:24]


def _whole(value: Any) -> Any:
    """The same value, in which whole numbers are integers."""
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, float) and value.is_integer():
        return int(value)
    if isinstance(value, Mapping):
        return {name: _whole(inner) for name, inner in value.items()}
    return [_whole(inner) for inner in value] if isinstance(value, list | tuple) else value


def _described(measure: Callable[..., Any], seen: frozenset[int] = frozenset()) -> list[Any]:
    """What tells a measure from others: its name, its code, and the values bound to it or taken from around it."""
    if isinstance(measure, functools.partial):
        bound = [*measure.args, sorted(measure.keywords.items())]
        return [*_described(measure.func, seen), _plain(bound, seen)]
    functions = _functions(measure)
    seen |= {id(function) for function in functions}
    named = [functions[-1].__qualname__, *(_compiled(function.__code__) for function in functions)]
    values = [value for function in functions for value in _values(function)]
    return [*named, _plain(values, seen)] if values else named


def _functions(measure: Any) -> list[Any]:
    """A function, and what decorators have put around it, outermost first: each has code and values of its own."""
    functions = []
    layer = None if inspect.ismethod(measure) else measure
    while layer is not None:
        if inspect.isfunction(layer):
            functions.append(layer)
        layer = getattr(layer, "__wrapped__", None)
    if not functions:
        raise TypeError(
            f"measure: expected a function that is written in Python, or functools.partial of one, found {measure!r}"
        )
    return functions


def _compiled(code: CodeType) -> list[Any]:
    """What a function does, alike in all processes of the same Python."""

    def told(constant: Any) -> Any:
        if isinstance(constant, CodeType):
            return _compiled(constant)
        if isinstance(constant, tuple):
            return [told(inner) for inner in constant]
        # In whatever order a set has here.
        return sorted(map(repr, constant)) if isinstance(constant, frozenset) else repr(constant)

    takes = [code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags]
    names = [code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars]
    # Where exceptions go is told apart from what is done since 3.11.
    handlers = getattr(code, "co_exceptiontable", b"")
    return [code.co_code.hex(), handlers.hex(), takes, names, told(code.co_consts)]


def _values(function: Any) -> Iterable[Any]:
    """What a function has besides its arguments: defaults, and what it takes from the functions around it."""
    yield from function.__defaults__ or ()
    yield from sorted((function.__kwdefaults__ or {}).items())
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        try:
            yield name, cell.cell_contents
        except ValueError:  # Nothing is in it yet.
            yield name, None


def _plain(value: Any, seen: frozenset[int]) -> Any:
    """Functions as what tells them from others; `seen` are those that are told already."""
    if isinstance(value, list | tuple):
        return [_plain(inner, seen) for inner in value]
    if inspect.ismodule(value) or id(value) in seen:
        return value.__name__
    if inspect.isfunction(value) or isinstance(value, functools.partial):
        return _described(value, seen)
    return value
