"""Which of the offered media types a client wants (RFC 9110, section 12.5.1)."""

from __future__ import annotations

from collections.abc import Sequence


def choose(accept: str | None, offers: Sequence[str]) -> str:
    """Returns the offer that the `Accept` header likes best; the first one where it likes none or all alike."""
    best, best_quality = offers[0], 0.0
    for offer in offers:
        quality = _quality(accept or "*/*", offer)
        if quality > best_quality:
            best, best_quality = offer, quality
    return best


def _quality(accept: str, offer: str) -> float:
    """Returns the quality that the most specific matching range gives to `offer`."""
    quality, specificity = 0.0, -1
    for entry in accept.split(","):
        media, *parameters = (part.strip() for part in entry.split(";"))
        rank = _match(media.lower(), offer)
        if rank > specificity:
            quality, specificity = _weight(parameters), rank
    return quality


def _match(media: str, offer: str) -> int:
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
