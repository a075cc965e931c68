"""Words of a plan that the page looks for."""

from planner.errors import CUT_SHORT
from tests.web.cell_models import ROOT


def test_the_page_knows_a_status_that_the_time_limit_ended():
    assert f'endsWith("{CUT_SHORT}")' in (ROOT / "web" / "src" / "state" / "words.ts").read_text()
    assert CUT_SHORT in (ROOT / "web" / "tests" / "words.test.ts").read_text()
