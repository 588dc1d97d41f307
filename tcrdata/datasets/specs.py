"""Reads the short spec that names a generated scene: `seed=3,frames=50`."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, TypeVar

from tcrdata.errors import DatasetError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

S = TypeVar("S", bound="DataclassInstance")


@dataclass(frozen=True)
class Limits:
    """What a number of a spec may be: low <= value <= high."""

    low: float
    high: float


def parse_spec(dataset: str, text: str | None, defaults: S, limits: dict[str, Limits]) -> S:
    """Return the defaults with the values of a spec such as `seed=3,frames=50`.

    Args:
        dataset: name for messages.
        text: the spec; None or empty for the defaults.
        defaults: a dataclass of int, float and bool fields.
        limits: of the number fields.

    Raises:
        DatasetError: for an unknown name, one given twice, or a value of the wrong kind or size.
    """
    known = {f.name: getattr(defaults, f.name) for f in fields(defaults)}
    given: dict[str, Any] = {}
    for item in filter(None, (part.strip() for part in (text or "").split(","))):
        name, equals, value = (piece.strip() for piece in item.partition("="))
        where = f"the {dataset} dataset's root {text!r}: {item!r}"
        if not equals or name not in known:
            raise DatasetError(
                f"{where} is no setting; a scene is named like "
                f"{format_spec(defaults)!r} (any of them may be left out)"
            )
        if name in given:
            raise DatasetError(f"{where} is given twice; give it once")
        given[name] = _value(where, value, known[name], limits.get(name))
    return type(defaults)(**{**known, **given})


def format_spec(spec: DataclassInstance) -> str:
    """Return the spec with every value written out, in the order of the fields."""
    pairs = ((f.name, getattr(spec, f.name)) for f in fields(spec))
    return ",".join(f"{name}={str(value).lower()}" for name, value in pairs)


def _value(where: str, text: str, default: Any, limits: Limits | None) -> Any:
    if isinstance(default, bool):
        if text not in ("true", "false"):
            raise DatasetError(f"{where} must be true or false")
        return text == "true"
    kind = type(default)
    try:
        value = kind(text)
    except ValueError as error:
        noun = "a whole number" if kind is int else "a number"
        raise DatasetError(f"{where} must be {noun}") from error
    if not math.isfinite(value) or (limits and not limits.low <= value <= limits.high):
        span = f"from {limits.low:g} to {limits.high:g}" if limits else "finite"
        raise DatasetError(f"{where} must be {span}")
    return value
