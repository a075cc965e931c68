"""How a demo ends that does not succeed."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import pytest
from click.testing import CliRunner

from api.cli import main
from api.cli.demo import LOG, Landings, _execute, _landing_error


class SilentService:
    """A service that takes every acknowledgement."""

    def acknowledge(self, cell: str) -> None:
        """Says nothing."""


def test_a_demo_that_fails_says_what_to_do_where_its_log_is_and_what_succeeded(monkeypatch: pytest.MonkeyPatch):
    def fail(folder: Path, cell: str, landings: Landings) -> float:
        (folder / LOG).write_text('{"event": "noise"}\n')
        landings.ideal_m = 0.0011
        landings.measured_m.append(0.073)
        late = {"id": "x", "outcome": "link_lost", "reason": "no new state for 40 ms", "metrics": None}
        monkeypatch.setattr("api.cli.demo.execute_plan", lambda *_, **__: late)
        return _landing_error(_execute(cast(Any, SilentService()), {"id": "p", "cell": cell}))

    monkeypatch.setattr("api.cli.demo._throw", fail)
    result = CliRunner().invoke(main, ["demo"])
    assert result.exit_code == 1
    assert "Ideal arm: the object landed 1.1 mm from the target." in result.stdout
    assert "1 throw with a tolerance of 100 mm: 73 mm" in result.stdout
    sentence, where = result.stderr.splitlines()
    assert sentence.startswith("fling: link_lost: no new state for 40 ms; ")
    assert "end other programs" in sentence
    log = Path(where.removeprefix("what the processes wrote: "))
    assert log.read_text() == '{"event": "noise"}\n'
    log.unlink()
