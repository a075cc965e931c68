"""Content negotiation by the `Accept` header (RFC 9110, section 12.5.1)."""

from __future__ import annotations

from collections.abc import Sequence


def preferred_media_type(accept: str | None, offers: Sequence[str]) -> str:
    """Returns the offer with the highest quality in `accept`; the first one on a tie or without a match."""
    return max(offers, key=lambda offer: _quality(accept or "*/*", offer))


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
