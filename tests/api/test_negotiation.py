from __future__ import annotations

import pytest

from api.http import preferred_media_type

OFFERS = ("application/json", "text/csv")


@pytest.mark.parametrize(
    ("accept", "chosen"),
    [
        (None, OFFERS[0]),
        ("", OFFERS[0]),
        ("*/*", OFFERS[0]),
        ("text/csv", OFFERS[1]),
        ("text/*", OFFERS[1]),
        ("image/png", OFFERS[0]),
        ("text/csv;q=0.5, application/json", OFFERS[0]),
        ("application/json;q=0, */*", OFFERS[1]),
        ("TEXT/CSV", OFFERS[1]),
        ("text/csv;q=nonsense", OFFERS[0]),
        ("application/json;q=0.1,text/csv;q=0.2", OFFERS[1]),
    ],
)
def test_the_offer_of_highest_quality_is_chosen(accept: str | None, chosen: str):
    assert preferred_media_type(accept, OFFERS) == chosen
