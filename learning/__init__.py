"""What a cell's own throws teach: the timing of its arm, the release of its gripper, the flight of its object.

Estimators stand on numpy, on the planner's trajectories and flights, and on records from the store; they know no
robot, no web and no solver.
"""

from learning.calibration import calibration_moves
from learning.hand_eye import CameraFit, TouchedPointsRefused, fit_camera, slip
from learning.joint_speeds import JointSpeeds, learn_joint_speeds
from learning.predictions import LandingForecast, forecast
from learning.profile import (
    CellKnowledge,
    cell_in_use,
    cell_with_profile,
    estimate_profile,
    is_drag_learnt,
    knowledge_of,
    prior_knowledge,
    profile_bytes,
)
from learning.recordings import RECORDING_BYTES, MotionRecording, RecordingError, recording_from_csv
from learning.release import ObservedThrow, ReleasePosterior, learn_release, prior_state
from learning.streamed_arm import FEEDBACK_GAIN, FEEDBACK_MAX, StreamedArm
from learning.throws import ThrowTable, throw_table
from learning.timing import JointTiming, TimingEstimate, estimate_timing
from learning.timing_history import lag_advice, lag_change, pool_timing, pooled_document, timing_runs

__all__ = [
    "FEEDBACK_GAIN",
    "FEEDBACK_MAX",
    "RECORDING_BYTES",
    "CameraFit",
    "CellKnowledge",
    "JointSpeeds",
    "JointTiming",
    "LandingForecast",
    "MotionRecording",
    "ObservedThrow",
    "RecordingError",
    "ReleasePosterior",
    "StreamedArm",
    "ThrowTable",
    "TimingEstimate",
    "TouchedPointsRefused",
    "calibration_moves",
    "cell_in_use",
    "cell_with_profile",
    "estimate_profile",
    "estimate_timing",
    "fit_camera",
    "forecast",
    "is_drag_learnt",
    "knowledge_of",
    "lag_advice",
    "lag_change",
    "learn_joint_speeds",
    "learn_release",
    "pool_timing",
    "pooled_document",
    "prior_knowledge",
    "prior_state",
    "profile_bytes",
    "recording_from_csv",
    "slip",
    "throw_table",
    "timing_runs",
]
