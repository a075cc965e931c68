"""What a cell's own throws teach: the timing of its arm, the release of its gripper, the flight of its object.

Estimators stand on numpy, on the planner's trajectories and flights, and on records from the store; they know no
robot, no web and no solver.
"""

from learning.recordings import MotionRecording, RecordingError, recording_from_csv
from learning.timing import JointTiming, TimingEstimate, estimate_timing
from learning.timing_history import lag_advice, lag_change, pool_timing, pooled_document, timing_runs

__all__ = [
    "JointTiming",
    "MotionRecording",
    "RecordingError",
    "TimingEstimate",
    "estimate_timing",
    "lag_advice",
    "lag_change",
    "pool_timing",
    "pooled_document",
    "recording_from_csv",
    "timing_runs",
]
