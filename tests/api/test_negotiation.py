from __future__ import annotations

import pytest

from api.http import ProblemDetails, has_current, preferred_media_type

OFFERS = ("application/json", "text/csv")


@pytest.mark.parametrize(
    ("accept", "chosen"),
    [
        (None, OFFERS[0]),
        ("", OFFERS[0]),
        ("*/*", OFFERS[0]),
        ("text/csv", OFFERS[1]),
        ("text/*", OFFERS[1]),
        ("text/csv;q=0.5, application/json", OFFERS[0]),
        ("application/json;q=0, */*", OFFERS[1]),
        ("TEXT/CSV", OFFERS[1]),
        ("text/csv;q=nonsense, */*", OFFERS[0]),
        ("application/json;q=0.1,text/csv;q=0.2", OFFERS[1]),
    ],
)
def test_the_offer_of_highest_quality_is_chosen(accept: str | None, chosen: str):
    assert preferred_media_type(accept, OFFERS) == chosen


@pytest.mark.parametrize("accept", ["image/png", "application/json;q=0", "text/csv;q=nonsense", "nonsense"])
def test_without_an_accepted_offer_the_offers_are_named(accept: str):
    with pytest.raises(ProblemDetails, match="text/csv") as caught:
        preferred_media_type(accept, OFFERS)
    assert (caught.value.name, caught.value.fields["offers"]) == ("not-acceptable", list(OFFERS))


@pytest.mark.parametrize(
    ("sent", "has"),
    [(None, False), ("", False), ('"a"', True), ('W/"a"', True), ('"b", W/"a"', True), ('"b"', False), ("*", True)],
)
def test_a_client_has_what_it_names(sent: str | None, has: bool):
    assert has_current(sent, 'W/"a"') is has
