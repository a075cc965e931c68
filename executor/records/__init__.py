"""Records of an execution: telemetry, recording, metrics, landing, and the journal that keeps them."""

from executor.records.further import further_releases, further_words
from executor.records.journal import MIN_FREE_BYTES, ExecutionResult, Journal, JournalLocked
from executor.records.landing import Landing, ObservedLanding, expect_throw, wait_for_landing
from executor.records.metrics import metrics, release_verdict, timing_advice, without_motion
from executor.records.recording import to_mcap, to_samples
from executor.records.telemetry import RunResult, Telemetry, row_document
from executor.records.timing import arm_timing

__all__ = [
    "MIN_FREE_BYTES",
    "ExecutionResult",
    "Journal",
    "JournalLocked",
    "Landing",
    "ObservedLanding",
    "RunResult",
    "Telemetry",
    "arm_timing",
    "expect_throw",
    "further_releases",
    "further_words",
    "metrics",
    "release_verdict",
    "row_document",
    "timing_advice",
    "to_mcap",
    "to_samples",
    "wait_for_landing",
    "without_motion",
]
