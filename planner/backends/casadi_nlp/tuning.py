"""The main numbers of the optimiser that were chosen by trial: what each does, and what another one costs.

The others stand where they are used.
"""

from __future__ import annotations

# Stages. A jerk-optimal motion has few switches, and braking is not hurried.
LAUNCH_STAGES = 8  # [-] fewer release later; more take longer per iteration and gain nothing
BRAKE_STAGES = 3  # [-] the same
WINDOW_STAGES = 3  # [-] in half a release window at most: one releases 2 to 3 % later, more converge less often
# [-] Of its initial length that a step may have: it may not collapse, and in a long one a motion dips below the floor.
SHORTEST_STEP = 0.15
LONGEST_STEP = 2.5

# [-] of a velocity limit, or [rad]: bounds that leave less room between them are an equality, as there is no interior
TOUCHING = 1e-3

# Cost. Weights beside the seconds of the launch.
BRAKE_WEIGHT = 0.05  # [-] of a second of braking: braking is not hurried, but ends
JERK_WEIGHT = 1e-3  # [-] of the mean squared scaled jerk: decides for joints that have time to spare
STEP_WEIGHT = 6e-2  # [-] of the mean squared relative change of a step: keeps steps from collapsing

# Margins, between what rows hold at knots and midpoints and what the certificate checks at all times. Smaller ones lead
# to more solves, larger ones to later releases.
USABLE = 0.98  # [-] share of a limit
ROOM_M = 0.002  # [m] between what moves and what it keeps off
OPENING_RAD = 0.03  # [rad] within the gripper's opening

# Solutions after what the solution before them lacks, and what is made of the certificate's findings.
CORRECTIONS = 3  # [-] further solutions at most for drag, for calibration, and for a window's landings
OVER = 1.5  # [-] times what is missing between two rows is asked of them: it is less there, and another motion follows

LEAVING = 2.0  # [-] times as long as in free fall an object may take out of the grip, as the tool falls, too
MAX_ITERATIONS = 120  # [-] of one call of fatrop: what takes longer rarely comes to a solution
