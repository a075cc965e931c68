"""Jobs of picks and throws: what is ordered, the motions, what comes next, and the record of a shift."""

from jobs.cycles.judgement import CycleEnd, combined_position, cycle_end
from jobs.cycles.motions import BRAKE_M_S2, PickLines, motion_request, raised
from jobs.cycles.order import JOB_REQUEST, JobOrder
from jobs.cycles.progress import MOVED, NOT_PLANNED, STAYED, THROWN, WENT, JobProgress, NextMotion
from jobs.cycles.record import object_results, progress_of, shift_record, wilson_interval

__all__ = [
    "BRAKE_M_S2",
    "JOB_REQUEST",
    "MOVED",
    "NOT_PLANNED",
    "STAYED",
    "THROWN",
    "WENT",
    "CycleEnd",
    "JobOrder",
    "JobProgress",
    "NextMotion",
    "PickLines",
    "combined_position",
    "cycle_end",
    "motion_request",
    "object_results",
    "progress_of",
    "raised",
    "shift_record",
    "wilson_interval",
]
