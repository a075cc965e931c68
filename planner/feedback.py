"""The position feedback that the executor adds to planned joint speeds; whoever predicts the streamed arm needs it."""

from __future__ import annotations

FEEDBACK_GAIN = 5.0  # [1/s] with a lag of 20 ms the loop loses 0.1 rad of phase: far from ringing
FEEDBACK_MAX = 0.05  # [rad/s] bound of the correction
