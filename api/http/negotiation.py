"""Content negotiation and conditional requests (RFC 9110, sections 12.5.1 and 13.1.2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from starlette.responses import Response

from api.problems import ProblemDetails


def preferred_media_type(accept: str | None, offers: Sequence[str]) -> str:
    """Returns the offer with the highest quality in `accept`; the first one on a tie.

    Raises:
        ProblemDetails: None of them is accepted.
    """
    best = max(offers, key=lambda offer: _quality(accept or "*/*", offer))
    if _quality(accept or "*/*", best) <= 0.0:
        raise ProblemDetails("not-acceptable", f"there is {', '.join(offers)}, not {accept!a}", offers=list(offers))
    return best


def unchanging(if_none_match: str | None, tag: str, make: Callable[[], Response]) -> Response:
    """Returns an answer that never changes under its `tag`, or 304 to a client that has it."""
    headers = {"ETag": f'W/"{tag}"', "Cache-Control": "private, no-cache"}
    if has_current(if_none_match, headers["ETag"]):
        return Response(None, 304, headers)
    response = make()
    response.headers.update(headers)
    return response


def has_current(if_none_match: str | None, tag: str) -> bool:
    """Returns whether a client that sends `If-None-Match` has what `tag` names already, by the weak comparison."""
    known = [entry.strip().removeprefix("W/") for entry in (if_none_match or "").split(",")]
    return "*" in known or tag.removeprefix("W/") in known


def _quality(accept: str, offer: str) -> float:
    """Returns the quality of the most specific media range that matches `offer`; 0 without a match."""
    ranges = ("*/*", offer.split("/")[0] + "/*", offer)
    entries = [[part.strip() for part in entry.split(";")] for entry in accept.split(",")]
    matches = [(ranges.index(media.lower()), parameters) for media, *parameters in entries if media.lower() in ranges]
    return _weight(max(matches, key=lambda match: match[0])[1]) if matches else 0.0


def _weight(parameters: Sequence[str]) -> float:
    try:
        return float(next((text[2:] for text in parameters if text.startswith("q=")), 1.0))
    except ValueError:
        return 0.0
