"""What a gripper reports of its fingers, or of its vacuum, and what follows from that."""

from __future__ import annotations


class ReportedFingers:
    """The newest report of a gripper.

    Attributes:
        told_open: whether it was told to open; None: nothing was told yet.
        reports: how many there were.
    """

    def __init__(self, step: float) -> None:
        """`step` is how far the opening changes until that is a motion, in the units of the reports."""
        self.step = step
        self.told_open: bool | None = None
        self.reports = 0
        self._opening: float | None = None
        self._asked_open: bool | None = None
        self._grips: bool | None = None
        self._closed_at: float | None = None
        self._gripped = False

    def tell(self, opens: bool) -> None:
        """Notes a command; what it was told before does not count any more."""
        if not opens:
            self._closed_at = None
            self._gripped = False
        self.told_open = opens

    def report(self, opening: float, grips: bool | None, still: bool, asked_open: bool | None = None) -> None:
        """Takes a report.

        Args:
            opening: of the fingers, more is wider.
            grips: whether it holds an object; None: it cannot tell just now.
            still: whether the fingers stand.
            asked_open: whether its newest command, whoever gave it, opens it; None: it does not tell.
        """
        self.reports += 1
        self._opening = opening
        self._asked_open = asked_open
        self._grips = grips
        if still and self.told_open is False and asked_open is not True:
            if self._closed_at is None or (grips is True and opening < self._closed_at):  # a vacuum builds up
                self._closed_at = opening
            self._gripped = self._gripped or grips is True

    @property
    def is_open(self) -> bool | None:
        """Whether it opens; None before it was seen closed."""
        if self._opening is None or self._closed_at is None:
            return self._asked_open
        moves = self._opening >= self._closed_at + self.step
        if self.told_open:
            return moves and self._asked_open is not False
        return moves or self._asked_open is True

    @property
    def is_closed(self) -> bool:
        """Whether it was seen to stand still since it was told to close."""
        return self._closed_at is not None

    @property
    def holds(self) -> bool | None:
        """Whether it stands closed with an object; None while it is not seen to stand."""
        return self._gripped if self.is_closed else None

    @property
    def motion(self) -> tuple[int, bool] | None:
        """Number of the newest report since it was told to open, and whether it stands wider than it was closed."""
        if self._opening is None or self._closed_at is None or not self.told_open:
            return None
        return self.reports, self._opening > self._closed_at

    @property
    def has_lost_object(self) -> bool:
        """Whether it gripped an object, closed further and grips none."""
        if not self._gripped or self.told_open or self._opening is None or self._closed_at is None:
            return False
        return self._grips is not True and self._opening <= self._closed_at - self.step
