"""Documents about the timing of an arm."""

from __future__ import annotations

from pydantic import BaseModel, Field

PerJoint = list[float | None]


class TimingNumbers(BaseModel):
    """Timing of the arm: of all joints together, and of each; null where nothing shows it."""

    lag_s: float = Field(description="From a command to its measured motion: delay and first-order part together [s].")
    lag_std_s: float = Field(description="Its standard error [s].")
    joint_lag_s: PerJoint = Field(description="Lag of each joint [s].")
    joint_lag_std_s: PerJoint = Field(description="[s]")
    gain: PerJoint = Field(description="Measured over commanded velocity [-].")
    gain_std: PerJoint = Field(description="[-]")
    first_order_s: PerJoint = Field(description="Time constant of the first-order part [s].")
    first_order_std_s: PerJoint = Field(description="[s]")
    overshoot: PerJoint = Field(description="Mean excess in the 40 ms after the peak, as a share of the peak [-].")
    overshoot_std: PerJoint = Field(description="[-]")
    mode: str = Field(description="speedj, servoj or script.")
    lag_change_s: float | None = Field(description="How far the lag is from the cell's, where that is significant [s].")


class TimingRunAnswer(TimingNumbers):
    """Timing of the arm in one execution."""

    execution_id: str
    assumed_lag_s: float = Field(description="Lag that the run was streamed with [s].")
    finished_at: str = Field(description="UTC, ISO 8601.")
    ramp_rad_s2: float | None = Field(description="Acceleration of speedj, where it held the arm back [rad/s^2].")
    residual_rms_rad_s: float = Field(description="What the timing does not explain, rms [rad/s].")
    rows: int = Field(description="Rows of the recording.")


class PooledTimingAnswer(TimingNumbers):
    """Timing of the arm over the newest runs in one mode."""

    runs: int
    advice: str | None = Field(description="What to set, where the lag has changed.")


class TimingAnswer(BaseModel):
    """Timing of a cell's arm, run by run and pooled."""

    cell: str
    assumed_lag_s: float = Field(description="`timing.lag_s` that plans are streamed with [s].")
    pooled: PooledTimingAnswer | None = Field(description="null before the first run.")
    runs: list[TimingRunAnswer] = Field(description="Newest first.")
