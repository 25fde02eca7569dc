"""Parameters of things that a page can change: choices and numbers among their constructors' arguments.

A class needs an attribute for each constructor argument, as all drawable classes of pyibr have. To change a parameter,
a new object is made from the attributes. Your own systems get controls in the same way.
"""

from __future__ import annotations

import inspect
import types
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, is_dataclass, replace
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

_Thing = TypeVar("_Thing")

Value = bool | int | float | str | None


@dataclass(frozen=True)
class Parameter:
    """An argument of a thing's class that a page can offer."""

    name: str  # of the argument and the attribute; a.b for a part of an argument
    kind: type  # bool, int, float, or str: one of `choices`, or without choices a typed number or word
    value: Value
    choices: tuple[str | None, ...] = ()  # allowed words; None is among them if the argument may be None
    may_be_none: bool = False  # whether the number is None at first; the page shows 0 for it


def parameters_of(things: Sequence[object]) -> dict[str, Parameter]:
    """All parameters of some things by name; if several things share a name, the first value is used."""
    found: dict[str, Parameter] = {}
    for thing in things:
        for parameter in _parameters_of_one(thing):
            found.setdefault(parameter.name, parameter)
    return found


def with_parameters(thing: _Thing, values: Mapping[str, Value]) -> _Thing:
    """The thing with the values that apply to its class; the same object if nothing changes.

    Words that are choices of another class only do not apply.

    Raises
    ------
    ArgumentError
        Raised by the thing's class, if a value is out of its range.
    """
    own = {parameter.name: parameter for parameter in _parameters_of_one(thing)}
    known = {name: value for name, value in values.items() if name in own and value in (own[name].choices or (value,))}
    changes = {name: value for name, value in known.items() if own[name].value != value}
    if not changes:
        return thing
    return type(thing)(**_changed(_arguments(thing) or {}, changes))


def _changed(arguments: Mapping[str, Any], changes: Mapping[str, Value]) -> dict[str, Any]:
    """Arguments with changed values, also of their parts."""
    made = dict(arguments)
    for name, value in changes.items():
        first, _, rest = name.partition(".")
        if not rest:
            made[first] = value
        elif isinstance(made[first], tuple):
            made[first] = tuple(value if str(place) == rest else one for place, one in enumerate(made[first]))
        else:
            made[first] = replace(made[first], **{rest: value})
    return made


def _parameters_of_one(thing: object) -> list[Parameter]:
    arguments = _arguments(thing)
    if arguments is None:
        return []
    try:
        hints = get_type_hints(type(thing).__init__)
    except Exception:  # hints may use names that do not exist at run time
        return []
    return [one for name, value in arguments.items() for one in _parameters_at(name, value, hints.get(name))]


def _parameters_at(name: str, value: Any, hint: object) -> list[Parameter]:
    choices, kind = _choices(hint), _number(hint)
    if choices and value in choices:
        return [Parameter(name, str, value, choices)]
    if kind and (isinstance(value, (bool, int, float)) or (kind is float and value is None)):
        return [Parameter(name, kind, None if value is None else kind(value), may_be_none=value is None)]
    if kind and (value is None or isinstance(value, str)):
        return [Parameter(name, str, value)]
    if isinstance(value, tuple):
        hints = next((get_args(one) for one in (hint, *get_args(hint)) if get_origin(one) is tuple), ())
        parts = zip(cast("tuple[Any]", value), hints, strict=False)
        return [one for place, (own, of) in enumerate(parts) for one in _parameters_at(f"{name}.{place}", own, of)]
    if is_dataclass(value):
        return [replace(one, name=f"{name}.{one.name}") for one in _parameters_of_one(value)]
    return []


def _arguments(thing: object) -> dict[str, Any] | None:
    """Constructor arguments that make the same thing again; None if attributes are missing."""
    try:
        parameters = inspect.signature(type(thing)).parameters.values()
    except (TypeError, ValueError):  # some classes have no signature
        return None
    found: dict[str, Any] = {}
    for parameter in parameters:
        if parameter.kind not in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY):
            return None
        if hasattr(thing, parameter.name):
            found[parameter.name] = getattr(thing, parameter.name)
        elif parameter.default is parameter.empty:
            return None
    return found


def _number(hint: object) -> type | None:
    """The type bool, int or float in a hint, also in a union with None or words; None if there is none."""
    hints = get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)
    return next((kind for kind in (bool, int, float) if kind in hints), None)


def _choices(hint: object) -> tuple[str | None, ...]:
    """The words of a `Literal`, preceded by None if the hint allows it."""
    if get_origin(hint) is Literal:
        return tuple(one for one in get_args(hint) if isinstance(one, str))
    if get_origin(hint) in (Union, types.UnionType):
        first, *others = get_args(hint)
        words = _choices(first)
        return (None, *words) if words and type(None) in others else words
    return ()
