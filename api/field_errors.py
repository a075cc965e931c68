"""What pydantic refuses, as plain sentences: the field, what stood there, what may, and which field was meant."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel

UNION_TAGS = ("float", "constrained-float", "int")  # branches of a union, in pydantic's locations
SHOWN = 40  # characters of a refused value that a sentence quotes
PATTERNS_NAMED = {"latest": "is neither a UUID nor 'latest'", "[0-9a-f]{8}-": "is not a UUID"}

Error = Mapping[str, Any]  # one entry of `ValidationError.errors()`


def refused_fields(errors: Sequence[Error], model: type[BaseModel] | None = None) -> list[dict[str, str]]:
    """Returns the refused fields, each with one reason.

    Args:
        errors: of pydantic, with locations that may begin with `body`.
        model: of the body; it knows which field a misspelt one was meant to be.
    """
    found: dict[str, str] = {}
    for error in errors:
        if not _is_other_branch(error):
            found.setdefault(field_path(_place(error)), reason(error, model))
    return [{"field": field, "reason": text} for field, text in found.items()]


def reason(error: Error, model: type[BaseModel] | None = None) -> str:
    """Returns why a field is refused, as the end of a sentence that begins with its name."""
    kind = error["type"]
    context = error.get("ctx") or {}
    value = error.get("input")
    if kind == "extra_forbidden":
        return _unknown(error["loc"], model)
    if kind == "json_invalid" and len(error["loc"]) > 1:
        return f"is not JSON at character {int(error['loc'][1]) + 1}: {str(context.get('error', '')).lower()}"
    if kind == "float_type" and error["loc"][-1:] == ("constrained-float",):
        return f"must be a number, or a list of numbers; it is {_shown(value)}"
    if kind in REASONS:
        return REASONS[kind](context, value)
    text = str(error["msg"]).removeprefix("Value error, ").removeprefix("Input ")
    return text[:1].lower() + text[1:]


def _place(error: Error) -> tuple[str | int, ...]:
    """Returns the location of the field that an error is about."""
    location = tuple(error["loc"])
    if error["type"] == "json_invalid":
        return location[:1]  # the place in the text follows
    if error["type"] in ("union_tag_invalid", "union_tag_not_found"):
        return *location, _tag_field(error["ctx"])
    return location


def _tag_field(context: Mapping[str, Any]) -> str:
    """Returns the name of the field that says which branch of a union is meant."""
    return str(context["discriminator"]).strip("'")


def field_path(location: Sequence[str | int]) -> str:
    """Returns ("body", "release", "joint", "positions", 3) as "release.positions[3]"; a header by its usual name."""
    if location[:1] == ("header",):
        return "-".join(str(part) for part in location[1:]).title()
    path = ""
    for i, part in enumerate(location):
        if isinstance(part, int):
            path += f"[{part}]"
        elif not _is_tag(location, i):
            path += f".{part}" if path else part
    return path or "body"


def _is_tag(location: Sequence[str | int], i: int) -> bool:
    """Returns whether a part of a location names a branch of a union, or the body itself."""
    part = location[i]
    if part == "body":
        return i == 0
    is_kind = i > 0 and location[i - 1] == "release" and part in ("pose", "point", "joint", "target")
    return is_kind or part in UNION_TAGS or "[" in str(part)


def _is_other_branch(error: Error) -> bool:
    """Returns whether an error is about the branch of a union of number and list that was not meant."""
    last = error["loc"][-1] if error["loc"] else ""
    value = error.get("input")
    if last in UNION_TAGS:
        return isinstance(value, list)
    return error["type"] == "list_type" and "[" in str(last) and not isinstance(value, list)


def _unknown(location: Sequence[str | int], model: type[BaseModel] | None) -> str:
    """Returns the reason of a field that does not exist, with the one that was meant."""
    known = (
        [] if model is None else sorted({name for kind in _models_at(location, model) for name in kind.model_fields})
    )
    similar = get_close_matches(str(location[-1]), known, n=1)
    if similar:
        return f"there is no such field; did you mean {similar[0]!r}?"
    return f"there is no such field; there are {', '.join(known)}" if known else "there is no such field"


def _models_at(location: Sequence[str | int], model: type[BaseModel]) -> list[type[BaseModel]]:
    """Returns the models that the last part of a location may be a field of."""
    models = [model]
    for part in location[:-1]:
        inner = [
            kind for at in models if part in at.model_fields for kind in _models_in(at.model_fields[part].annotation)
        ]
        models = inner or [at for at in models if _is_kind(at, part)] or models
    return models


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yields the models within an annotation such as `Pose | None`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in () if get_origin(annotation) is Literal else get_args(annotation):
        yield from _models_in(part)


def _is_kind(model: type[BaseModel], tag: str | int) -> bool:
    """Returns whether a model is the branch `tag` of a union that `kind` discriminates."""
    return "kind" in model.model_fields and tag in get_args(model.model_fields["kind"].annotation)


def _shown(value: Any) -> str:
    """Returns a value as a sentence quotes it: a text in single quotes, everything else as JSON."""
    text = ascii(value) if isinstance(value, str) else json.dumps(value, default=str)
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}…"


def _named(value: Any) -> str:
    """Returns what kind of JSON a value is."""
    names = {dict: "an object", list: "a list", str: "a text", bool: "true or false", type(None): "null"}
    return names.get(type(value), "a number")


def _choice(context: Mapping[str, Any], value: Any) -> str:
    """Returns the reason of a value that is none of a few."""
    offered = str(context.get("expected") or context.get("expected_tags", "")).replace(" or ", ", ").replace("'", "")
    if offered == "True":
        return f"may only be true, or be left out; it is {_shown(value)}"
    given = value[_tag_field(context)] if "tag" in context else value  # the tag itself is a text
    similar = get_close_matches(str(given), offered.split(", "), n=1)
    meant = f"; did you mean {similar[0]!r}?" if similar else ""
    return f"{_shown(given)} is none of {offered}{meant}"


def _length(context: Mapping[str, Any], value: Any) -> str:
    """Returns the reason of a list that is too short or too long."""
    bound = context.get("min_length", context.get("max_length"))
    words = "at least" if "min_length" in context else "at most"
    return f"has {context['actual_length']} entries; it needs {words} {bound}"


def _text_length(context: Mapping[str, Any], value: Any) -> str:
    words = f"at least {context['min_length']}" if "min_length" in context else f"at most {context['max_length']}"
    return f"has {len(value)} characters; it may have {words}"


def _pattern(context: Mapping[str, Any], value: Any) -> str:
    named = next((text for part, text in PATTERNS_NAMED.items() if part in context["pattern"]), None)
    return f"{_shown(value)} {named or 'has a character, or a length, that is not allowed'}"


def _must_be(what: str) -> Callable[[Mapping[str, Any], Any], str]:
    return lambda context, value: f"must be {what}; it is {_shown(value)}"


def _bound(words: str, name: str) -> Callable[[Mapping[str, Any], Any], str]:
    return lambda context, value: f"must be {words} {context[name]:.12g}; it is {_shown(value)}"


def _object(context: Mapping[str, Any], value: Any) -> str:
    return f"must be a JSON object, not {_named(value)}"


REASONS: dict[str, Callable[[Mapping[str, Any], Any], str]] = {
    "missing": lambda context, value: "is missing",
    "json_invalid": lambda context, value: f"is not JSON: {str(context.get('error', '')).lower()}",
    "model_type": _object,
    "model_attributes_type": _object,
    "dict_type": _object,
    "list_type": lambda context, value: f"must be a list, not {_named(value)}",
    "string_type": lambda context, value: f"must be a text, not {_named(value)}",
    "float_type": _must_be("a number"),
    "float_parsing": _must_be("a number"),
    "finite_number": _must_be("a finite number"),
    "int_type": _must_be("a whole number"),
    "int_parsing": _must_be("a whole number"),
    "int_parsing_size": _must_be("a whole number of usual size"),
    "int_from_float": _must_be("a whole number"),
    "bool_type": _must_be("true or false"),
    "bool_parsing": _must_be("true or false"),
    "greater_than": _bound("above", "gt"),
    "greater_than_equal": _bound("at least", "ge"),
    "less_than": _bound("below", "lt"),
    "less_than_equal": _bound("at most", "le"),
    "too_short": _length,
    "too_long": _length,
    "string_too_short": _text_length,
    "string_too_long": _text_length,
    "string_pattern_mismatch": _pattern,
    "literal_error": _choice,
    "union_tag_invalid": _choice,
    "union_tag_not_found": lambda context, value: "is missing; it says what the other fields mean",
}
