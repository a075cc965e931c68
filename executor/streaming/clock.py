"""The controller's clock: a tick begins when a new timestamp arrives; lost ticks are counted, never made up."""

from __future__ import annotations

from time import monotonic, sleep

from executor.streaming.rtde_connection import RtdeConnection
from executor.streaming.state_checks import StreamFault

POLL_S = 50e-6  # [s] between two readings of the timestamp
EARLY_S = 400e-6  # [s] polling begins so long before the next timestamp is due
STALE_S = 0.040  # [s] without a new timestamp the connection is lost: 20 e-Series ticks
REALTIME_BOUNDS = (0.016, 0.10)  # [s] in a row, less than the watchdog bears; [-] share of the recent ticks
ORDINARY_BOUNDS = (0.040, 0.30)  # the same without real-time scheduling, which is for simulated cells
# [-] share of the recent ticks lost while this thread had its processor, whatever its scheduling; source: libfranka's
# communication test calls a success rate below 0.95 "many packets got lost"
LINK_SHARE = 0.05
IN_A_ROW_MIN = 2  # [ticks] a CB3 arm sends one in 8 ms
OWN_GAP_S = 0.010  # [s] between two readings: this process was suspended, and the timestamp's age is unknown
# [s] after the newest state in which a suspension excuses that none was seen: a machine that suspends this process in
# every reading would hide a silent link for ever. The slowest watchdog (10 Hz) has stopped the arm by then.
EXCUSED_S = 0.1
MEMORY_S = 0.2  # [s] over which lost ticks are forgotten


class Silence:
    """The time without a new state, from where this process was last suspended: before that, one may have come unseen.

    Suspensions count so only if they begin within `EXCUSED_S` of the newest state.
    """

    def __init__(self, state_s: float, most_s: float) -> None:
        """Begins to wait.

        Args:
            state_s: monotonic time at which the newest state was read [s].
            most_s: longest accepted time without another one [s].
        """
        self.excused_until = state_s + EXCUSED_S
        self.most_s = most_s
        self.begin = self.polled = monotonic()

    def look(self) -> None:
        """Notes that the newest state is still the same.

        Raises:
            StreamFault: it has been for too long.
        """
        now = monotonic()
        if now - self.polled > OWN_GAP_S and self.polled < self.excused_until:
            self.begin = now
        self.polled = now
        if now - self.begin > self.most_s:
            raise StreamFault("link_lost", f"no new state for {self.most_s * 1e3:.0f} ms")


class ControllerClock:
    """Counts ticks by the controller's timestamps.

    Attributes:
        first, stamp: the timestamp of tick 0 and the newest one [s].
        tick: whole ticks since the first timestamp.
        missed: ticks lost before this one.
        total_missed: ticks lost so far.
        host_s: monotonic time at which the newest timestamp was read [s].
    """

    def __init__(self, connection: RtdeConnection, dt: float, first_s: float | None = None) -> None:
        """Starts counting: from the timestamp nearest to `first_s` [s], or from the present one."""
        self.connection = connection
        self.dt = dt
        self.first = self.stamp = connection.timestamp()
        self.tick = self.missed = self.total_missed = 0
        if first_s is not None:
            self.tick = max(round((self.stamp - first_s) / dt), -1)  # the first row is due now, or next
            self.first = self.stamp - self.tick * dt
        self.host_s = monotonic()

    def wait(self) -> None:
        """Returns at the next new timestamp.

        Raises:
            StreamFault: none came in time, or time ran backwards.
        """
        rest = self.host_s + self.dt - EARLY_S - monotonic()
        if rest > 0.0:
            sleep(rest)
        silence = Silence(self.host_s, STALE_S)
        while (stamp := self.connection.timestamp()) == self.stamp:
            sleep(POLL_S)
            silence.look()
        self.host_s = monotonic()
        self._count(stamp)

    def _count(self, stamp: float) -> None:
        tick = round((stamp - self.first) / self.dt)
        if tick <= self.tick:
            raise StreamFault("link_lost", "the controller's time ran backwards")
        self.missed = tick - self.tick - 1
        self.total_missed += self.missed
        self.tick = tick
        self.stamp = stamp


class LostTicks:
    """Limits on lost ticks: in a row, recently, and those lost by the link.

    Without real-time scheduling a busy machine delays this thread, so the bounds are wider, yet below the watchdog's
    50 ms. A tick lost while the thread had a processor was lost by the link: those have one bound everywhere, and a
    bad link is noticed as early without real-time scheduling as with it.

    Attributes:
        in_a_row: ticks lost in a row that end the run.
        most: recently lost ticks that end the run.
        most_by_link: recently lost ticks that end the run if the link lost them.
        memory: recent ticks.
    """

    def __init__(self, dt: float, realtime: bool) -> None:
        """Sets the bounds for ticks of `dt` [s], with or without real-time scheduling."""
        in_a_row_s, share = REALTIME_BOUNDS if realtime else ORDINARY_BOUNDS
        self.dt = dt
        self.memory = MEMORY_S / dt
        self.in_a_row = max(IN_A_ROW_MIN, round(in_a_row_s / dt))
        self.most = share * self.memory
        self.most_by_link = LINK_SHARE * self.memory
        self.recent = self.by_link = 0.0

    @property
    def cause(self) -> str:
        """Whether the link or this machine lost the recent ticks."""
        by_link = self.by_link > self.most_by_link or self.by_link >= 0.5 * self.recent
        return "the link lost them" if by_link else "this machine was busy"

    def are_too_many(self, missed: int, delayed_s: float) -> bool:
        """Returns whether the run must end.

        Args:
            missed: ticks lost before this one.
            delayed_s: time this thread waited for a processor since the last tick [s].
        """
        self.recent += missed - self.recent / self.memory
        self.by_link += max(0.0, missed - delayed_s / self.dt) - self.by_link / self.memory
        return missed >= self.in_a_row or self.recent > self.most or self.by_link > self.most_by_link
