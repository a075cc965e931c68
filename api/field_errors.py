"""Refused fields as plain sentences: what pydantic refuses, and what is refused of a request that was completed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pydantic import BaseModel

from planner.errors import ERRORS_MAX, FieldError
from planner.fields import did_you_mean, named, short_name, shown, unknown_field
from planner.request import tracked_targets

LIMITED = {"velocities": "velocity", "accelerations": "acceleration"}  # of a start, by the limits that they obey
PATTERNS_NAMED = {"latest": "is neither a UUID nor 'latest'", "[0-9a-f]{8}-": "is not a UUID"}

Error = Mapping[str, Any]  # one entry of `ValidationError.errors()`


def refused_fields(errors: Sequence[Error], model: type[BaseModel] | None = None) -> list[dict[str, str]]:
    """Returns the first `ERRORS_MAX` refused fields, each with one reason.

    Args:
        errors: of pydantic, with locations that may begin with `body`.
        model: of the body; it knows which field a misspelt one was meant to be.
    """
    found: dict[str, str] = {}
    for error in errors:
        if len(found) == ERRORS_MAX:
            break
        found.setdefault(field_path(_place(error)), reason(error, model))
    return [{"field": field, "reason": text} for field, text in found.items()]


def named_as_sent(sent: Mapping[str, Any], errors: Sequence[FieldError]) -> list[FieldError]:
    """Returns what is refused of a request that the service completed, by the fields that the client sent.

    The service adds the state in which a motion begins, and the numbers of a tracked target. An error in these is one
    of what names them, or of the tighter limit that the state to begin in is beyond.

    Args:
        sent: the request without what was added.
        errors: of the whole request.
    """
    return [_of_start(sent, _of_target(sent, error)) for error in errors]


def _of_target(sent: Mapping[str, Any], error: FieldError) -> FieldError:
    """Returns an error in what is known of a tracked target as one of its id."""
    for path, state in tracked_targets(sent).items():
        name = error.field.removeprefix(f"{path}.")
        if name != error.field and name.split(".")[0] not in state:  # among them a number of the position
            return FieldError(f"{path}.position.target", f"its {name}: {error.reason}")
    return error


def _of_start(sent: Mapping[str, Any], error: FieldError) -> FieldError:
    """Returns an error in a state to begin in that was not sent as one of what names it, or of a limit."""
    start = sent.get("start") or {}
    name = error.field.removeprefix("start.")
    plain = name.split("[")[0]
    if name == error.field or plain in start:
        return error
    limit = LIMITED.get(plain, "")
    by_limit = f"limits.{limit}" if limit in (sent.get("limits") or {}) else ""
    by_start = "start.at_s" if "at_s" in start else "start.current" if "current" in start else "start"
    return FieldError(by_limit or by_start, f"the {name} to begin with: {error.reason}")


def reason(error: Error, model: type[BaseModel] | None = None) -> str:
    """Returns why a field is refused, as the end of a sentence that begins with its name."""
    kind = error["type"]
    context = error.get("ctx") or {}
    value = error.get("input")
    if kind == "extra_forbidden":
        return _unknown(error["loc"], model)
    if kind == "json_invalid" and len(error["loc"]) > 1:
        return f"is not JSON at character {int(error['loc'][1]) + 1}: {str(context.get('error', '')).lower()}"
    if kind in REASONS:
        return REASONS[kind](context, value)
    text = str(error["msg"]).removeprefix("Value error, ").removeprefix("Input ")
    return text[:1].lower() + text[1:]


def _place(error: Error) -> tuple[str | int, ...]:
    """Returns the location of the field that an error is about."""
    location = tuple(error["loc"])
    if error["type"] == "json_invalid":
        return location[:1]  # the place in the text follows
    return location


def field_path(location: Sequence[str | int]) -> str:
    """Returns ("body", "position", 2) as "position[2]"; a header by its usual name."""
    if location[:1] == ("header",):
        return "-".join(str(part) for part in location[1:]).title()
    path = ""
    for part in location[1:] if location[:1] == ("body",) else location:
        if isinstance(part, int):
            path += f"[{part}]"
        else:
            path += f".{short_name(part)}" if path else short_name(part)
    return path or "body"


def _unknown(location: Sequence[str | int], model: type[BaseModel] | None) -> str:
    """Returns the reason of a field that does not exist, with the one that was meant."""
    is_of_body = len([part for part in location if part != "body"]) == 1
    if model is None or not is_of_body:
        return "there is no such field"
    return unknown_field(str(location[-1]), model.model_fields)


def _choice(context: Mapping[str, Any], value: Any) -> str:
    """Returns the reason of a value that is not one of a few."""
    offered = str(context["expected"]).replace(" or ", ", ").replace("'", "")
    return f"{shown(value)} is not one of {offered}{did_you_mean(value, offered.split(', '))}"


def _length(context: Mapping[str, Any], value: Any) -> str:
    """Returns the reason of a list that is too short or too long."""
    bound = context.get("min_length", context.get("max_length"))
    words = "at least" if "min_length" in context else "at most"
    return f"has {context['actual_length']} entries; it needs {words} {bound}"


def _text_length(context: Mapping[str, Any], value: Any) -> str:
    words = f"at least {context['min_length']}" if "min_length" in context else f"at most {context['max_length']}"
    return f"has {len(value)} characters; it may have {words}"


def _pattern(context: Mapping[str, Any], value: Any) -> str:
    words = next((text for part, text in PATTERNS_NAMED.items() if part in context["pattern"]), None)
    return f"{shown(value)} {words or 'has a character, or a length, that is not allowed'}"


def _must_be(what: str) -> Callable[[Mapping[str, Any], Any], str]:
    return lambda context, value: f"must be {what}; it is {shown(value)}"


def _bound(words: str, name: str) -> Callable[[Mapping[str, Any], Any], str]:
    return lambda context, value: f"must be {words} {context[name]:.12g}; it is {shown(value)}"


def _object(context: Mapping[str, Any], value: Any) -> str:
    return f"must be a JSON object, not {named(value)}"


REASONS: dict[str, Callable[[Mapping[str, Any], Any], str]] = {
    "missing": lambda context, value: "is missing",
    "json_invalid": lambda context, value: f"is not JSON: {str(context.get('error', '')).lower()}",
    "model_type": _object,
    "model_attributes_type": _object,
    "dict_type": _object,
    "list_type": lambda context, value: f"must be a list, not {named(value)}",
    "string_type": lambda context, value: f"must be a text, not {named(value)}",
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
}
