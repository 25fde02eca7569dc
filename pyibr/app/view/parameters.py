"""Parameters of things that a page can change: the choices and numbers of their constructors.

Any class will do whose arguments are its attributes, as those of all of pyibr's things are: a thing of that class with
one of them changed is made anew from the attributes. So a system of your own has controls, too.
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
    """An argument of a thing's class that a page can offer.

    Attributes
    ----------
    name : str
        Of the argument, and of the attribute; ``a.b`` of what an argument consists of.
    kind : type
        bool, int, float, or str: for one of `choices`, or, without any, for a number or a word that is typed.
    value : bool, int, float, str or None
        What the thing has.
    choices : tuple of str or None
        None among them: the argument may be None, too.
    may_be_none : bool
        A number that is None at first; on the page 0 stands for it.
    """

    name: str
    kind: type
    value: Value
    choices: tuple[str | None, ...] = ()
    may_be_none: bool = False

    def may_be(self, value: Value) -> bool:
        """Tell whether a value is one of the choices, if there are any."""
        return not self.choices or value in self.choices


def parameters_of(things: Sequence[object]) -> dict[str, Parameter]:
    """All parameters of some things by their names; where several have one of a name, the first one's value counts."""
    found: dict[str, Parameter] = {}
    for thing in things:
        for parameter in _parameters_of_one(thing):
            found.setdefault(parameter.name, parameter)
    return found


def with_parameters(thing: _Thing, values: Mapping[str, Value]) -> _Thing:
    """The thing with those of the values that its class knows; itself if they are what it has.

    A word that is another class's choice alone is none of them.

    Raises
    ------
    ArgumentError
        By the thing's class, if a value is out of its range.
    """
    own = {parameter.name: parameter for parameter in _parameters_of_one(thing)}
    known = {name: value for name, value in values.items() if name in own and own[name].may_be(value)}
    changes = {name: value for name, value in known.items() if own[name].value != value}
    if not changes:
        return thing
    return type(thing)(**_changed(_arguments(thing) or {}, changes))


def _changed(arguments: Mapping[str, Any], changes: Mapping[str, Value]) -> dict[str, Any]:
    """Arguments with those values, also in what they consist of."""
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
    except Exception:  # a class may name in its hints what is not there at run time
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
    """Constructor arguments that make the same thing again; None if its attributes do not tell."""
    try:
        parameters = inspect.signature(type(thing)).parameters.values()
    except (TypeError, ValueError):  # not all classes say how they are made
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
    """bool, int or float, also one beside None or words; None if the hint is none of them."""
    hints = get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)
    return next((kind for kind in (bool, int, float) if kind in hints), None)


def _choices(hint: object) -> tuple[str | None, ...]:
    """The words of a `Literal`; and None, if that may stand beside them."""
    if get_origin(hint) is Literal:
        return tuple(one for one in get_args(hint) if isinstance(one, str))
    if get_origin(hint) in (Union, types.UnionType):
        first, *others = get_args(hint)
        words = _choices(first)
        return (None, *words) if words and type(None) in others else words
    return ()
