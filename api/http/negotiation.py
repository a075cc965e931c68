"""Content negotiation by the `Accept` header (RFC 9110, section 12.5.1)."""

from __future__ import annotations

from collections.abc import Sequence


def preferred_media_type(accept: str | None, offers: Sequence[str]) -> str:
    """Returns the offer with the highest quality in `accept`; the first one on a tie or without a match."""
    best, best_quality = offers[0], 0.0
    for offer in offers:
        quality = _quality(accept or "*/*", offer)
        if quality > best_quality:
            best, best_quality = offer, quality
    return best


def _quality(accept: str, offer: str) -> float:
    """Returns the quality of the most specific media range that matches `offer`."""
    quality, specificity = 0.0, -1
    for entry in accept.split(","):
        media, *parameters = (part.strip() for part in entry.split(";"))
        rank = _specificity(media.lower(), offer)
        if rank > specificity:
            quality, specificity = _weight(parameters), rank
    return quality


def _specificity(media: str, offer: str) -> int:
    if media == offer:
        return 2
    if media == offer.split("/")[0] + "/*":
        return 1
    return 0 if media == "*/*" else -1


def _weight(parameters: Sequence[str]) -> float:
    for parameter in parameters:
        if parameter.startswith("q="):
            try:
                return float(parameter[2:])
            except ValueError:
                return 0.0
    return 1.0
