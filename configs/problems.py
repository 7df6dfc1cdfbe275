"""`one_line`: a validation error of pydantic as one line: the field, what was found, what is valid."""

from __future__ import annotations

import types
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

BaseModelType = type[BaseModel] | None

_OUT_OF_RANGE = ("greater_than_equal", "less_than_equal", "greater_than", "less_than")
_LONGEST_SHOWN = 64
"""Characters of a text that does not match its pattern that are shown: what is expected must fit into the line."""

_OTHERS_NAMED = 3
"""Fields with further problems that are named."""


@dataclass(frozen=True)
class Wording:
    """What a pattern matches, in words: an entry of the `Annotated` of a text, beside the pattern.

    Attributes:
        words: that follow "expected".
    """

    words: str


def one_line(error: ValidationError, model: type[BaseModel] | None, skip: int = 0) -> tuple[str, str]:
    """The first problem: its field, "" for the whole, and what is wrong with it.

    Args:
        model: that was validated; None: unknown.
        skip: parts of a problem's place that are no fields of the model, such as the tag of a union.
    """
    problems = error.errors(include_url=False)
    # Unknown fields first: a misspelt name is often the reason for a missing field.
    first = next((problem for problem in problems if problem["type"] == "extra_forbidden"), problems[0])
    place = first["loc"][skip:]
    field = _named(place)
    message = _told(first["type"], first.get("input"), first["msg"], *_expected(model, place))
    others = [_named(problem["loc"][skip:]) for problem in problems if problem is not first]
    named = ", ".join(dict.fromkeys(filter(None, others[:_OTHERS_NAMED])))
    more = f" (and {len(others)} more{': ' if named else ''}{named})" if others else ""
    return field, message + more


def _named(place: Sequence[str | int]) -> str:
    """A place as text; of the numbers of a position their axes: "hand.position_m.x"."""
    axes = {(before, number) for before, number in pairwise(place) if before == "position_m" and number in (0, 1, 2)}
    return ".".join(
        "xyz"[int(part)] if number and (place[number - 1], part) in axes else str(part)
        for number, part in enumerate(place)
    )


def _told(kind: str, found: Any, message: str, known: BaseModelType, annotation: Any, limits: Sequence[Any]) -> str:
    if kind == "extra_forbidden":
        names = "" if known is None else ", ".join(known.model_fields)
        return f"unknown field, expected one of: {names}" if names else "unknown field, there are none"
    words = " or ".join(map(repr, get_args(annotation))) if get_origin(annotation) is Literal else ""
    if kind == "missing":
        return f"missing, expected {words}" if words else "missing"
    if kind == "literal_error" and words:
        return f"{found!r}, expected {words}"
    if kind in _OUT_OF_RANGE and (span := _span(limits)):
        return f"{found!r}, expected {span}"
    pattern = next((one.words for one in limits if isinstance(one, Wording)), None)
    if kind == "string_pattern_mismatch" and pattern is not None:
        return f"{str(found)[:_LONGEST_SHOWN]!r}, expected {pattern}"
    if kind == "string_too_short":
        return "empty, expected at least one character"
    return message.removeprefix("Value error, ")


def _span(limits: Sequence[Any]) -> str:
    """What a number may be, with its unit."""
    least = next((f"{one.ge:g}" for one in limits if isinstance(one, Ge)), None)
    most = next((f"{one.le:g}" for one in limits if isinstance(one, Le)), None)
    above = next((f"more than {one.gt:g}" for one in limits if isinstance(one, Gt)), None)
    below = next((f"less than {one.lt:g}" for one in limits if isinstance(one, Lt)), None)
    unit = next((f" {one}" for one in limits if isinstance(one, str)), "")
    if least is not None and most is not None:
        return f"{least} to {most}{unit}"
    parts = (above, least and f"{least} or more", below, most and f"{most} at most")
    return (" and ".join(filter(None, parts)) + unit) if any(parts) else ""


def _expected(model: BaseModelType, place: Sequence[str | int]) -> tuple[BaseModelType, Any, Sequence[Any]]:
    """The model of a place, and annotation and limits (with their unit, a string) of the value there."""
    known, annotation, limits = model, Any, tuple[Any, ...]()
    current: Any = model
    for part in place:
        current = _plain(current)[0]
        if isinstance(current, type) and issubclass(current, BaseModel):
            known = current
            info = current.model_fields.get(str(part))
            if info is None:
                return known, Any, ()
            annotation, inner = _plain(info.annotation)
            limits = (*_limits(info), *inner)
        elif isinstance(part, int) and get_args(current):
            args = get_args(current)
            entry = args[min(part, len(args) - 1)]
            annotation, limits = _plain(entry if entry is not ... else args[0])
        else:
            return known, Any, ()
        current = annotation
    return known, annotation, limits


def _plain(annotation: Any) -> tuple[Any, tuple[Any, ...]]:
    """An annotation without None and `Annotated`, and its limits."""
    limits: tuple[Any, ...] = ()
    while True:
        if get_origin(annotation) is Annotated:
            annotation, *notes = get_args(annotation)
            for note in notes:
                limits = (*limits, *(_limits(note) if isinstance(note, FieldInfo) else (note,)))
        elif get_origin(annotation) in (Union, types.UnionType):
            rest = [one for one in get_args(annotation) if one is not type(None)]
            if len(rest) != 1:
                return annotation, limits
            annotation = rest[0]
        else:
            return annotation, limits


def _limits(info: FieldInfo) -> tuple[Any, ...]:
    """Limits of a field, and its unit: what its description has in brackets."""
    described = info.description or ""
    unit = described[described.find("[") + 1 : described.find("]")] if "[" in described else ""
    return (*info.metadata, *([unit] if unit else []))
