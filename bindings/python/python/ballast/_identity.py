"""Identity of a study's point: a hash of everything that its figures depend on."""

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


def point_key(case: ballast.Case, bed_key: str, point: Mapping[str, Any], measure: Callable[..., Any]) -> str:
    """Returns the hash of a case, a point, the key of the point's bed, and a measure: the name of the point's file."""
    values = sorted((name, _normalised(value)) for name, value in point.items())
    # The pickled text: `case.text` raises for seeds that TOML cannot hold.
    _, (text, *_) = case.__reduce__()
    description = _description(measure)
    parts = [ballast.__version__, text, case.seed, case.schedule, bed_key, values, measure_name(measure), description]
    try:
        return _digest(parts)
    except (TypeError, ValueError) as error:
        raise TypeError(
            f"point {dict(point)} of measure {description[0]}: its values, and those that the measure binds or closes over, "
            f"identify its results, and one cannot be written as JSON: {error}"
        ) from None


def measure_name(measure: Callable[..., Any]) -> str:
    """Returns the module and name of a measure."""
    while isinstance(measure, functools.partial):
        measure = measure.func
    function = _functions(measure)[-1]
    return f"{function.__module__}.{function.__qualname__}"


def code_digest(measure: Callable[..., Any]) -> str:
    """Returns the hash of a measure's compiled code and bound values, equal in all processes of one Python version."""
    return _digest(_description(measure))


def _digest(parts: list[Any]) -> str:
    return hashlib.sha256(dumps(parts).encode()).hexdigest()[:24]


def _normalised(value: Any) -> Any:
    """Returns a value with whole floats as integers: 20 and 20.0 are the same point."""
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, float) and value.is_integer():
        return int(value)
    if isinstance(value, Mapping):
        return {name: _normalised(item) for name, item in value.items()}
    return [_normalised(item) for item in value] if isinstance(value, list | tuple) else value


def _description(measure: Callable[..., Any], seen: frozenset[int] = frozenset()) -> list[Any]:
    """Returns name, code, and the values that a measure binds or closes over."""
    if isinstance(measure, functools.partial):
        bound = [*measure.args, sorted(measure.keywords.items())]
        return [*_description(measure.func, seen), _without_functions(bound, seen)]
    functions = _functions(measure)
    seen |= {id(function) for function in functions}
    parts = [functions[-1].__qualname__, *(_code_parts(function.__code__) for function in functions)]
    values = [value for function in functions for value in _bound_values(function)]
    return [*parts, _without_functions(values, seen)] if values else parts


def _functions(measure: Any) -> list[Any]:
    """Returns a function and its decorators' wrappers, outermost first."""
    functions = []
    layer = None if inspect.ismethod(measure) else measure
    while layer is not None:
        if inspect.isfunction(layer):
            functions.append(layer)
        layer = getattr(layer, "__wrapped__", None)
    if not functions:
        raise TypeError(f"measure: expected a Python function, or functools.partial of one, found {measure!r}")
    return functions


def _code_parts(code: CodeType) -> list[Any]:
    """Returns the parts of compiled code that define its behaviour."""

    def constant_text(constant: Any) -> Any:
        if isinstance(constant, CodeType):
            return _code_parts(constant)
        if isinstance(constant, tuple):
            return [constant_text(item) for item in constant]
        # The order of a set differs between processes.
        return sorted(map(repr, constant)) if isinstance(constant, frozenset) else repr(constant)

    arguments = [code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags]
    names = [code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars]
    return [code.co_code.hex(), code.co_exceptiontable.hex(), arguments, names, constant_text(code.co_consts)]


def _bound_values(function: Any) -> Iterable[Any]:
    """Yields the defaults and closure values of a function."""
    yield from function.__defaults__ or ()
    yield from sorted((function.__kwdefaults__ or {}).items())
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        try:
            yield name, cell.cell_contents
        except ValueError:  # The cell is empty.
            yield name, None


def _without_functions(value: Any, seen: frozenset[int]) -> Any:
    """Returns a value with descriptions in place of functions; `seen` functions and modules become their names."""
    if isinstance(value, list | tuple):
        return [_without_functions(item, seen) for item in value]
    if inspect.ismodule(value) or id(value) in seen:
        return value.__name__
    if inspect.isfunction(value) or isinstance(value, functools.partial):
        return _description(value, seen)
    return value
