"""System tests: real processes, the real ur_rtde client, a simulated controller.

Faults beyond the matrix (`fault_matrix.py`) have numbers; the arm is at rest within 150 ms unless said:

R5 local mode; R6 slider below 100 %; R15 another client owns the registers; R20 another robot: `refused`
R13 the arm lags five times as much as the cell file states: `tracking`
R16 a script of another client that plays, moves, or does not compile: `foreign_program`, at rest within 250 ms
R17 the arm is 3 % too fast: `held`, at the plan's end
R18 the gripper's output is opened or closed by another client, or deaf: `released_early`, `not_released`
R19 a stop between the gripper's command and the release: that of the stop, with where the object is
H1, H2 streaming process or daemon killed or frozen, also as the control connection is reset: `executor_lost`
H1, H2 the streaming process that waits for the next execution killed or frozen: `completed`, by another one
H3, H5 service stopped or killed; the wall clock jumps by hours: `completed`
H4, H9 every processor taken; no permission for real time: `completed`, or `late` without real time
H6 disk full before: `refused`; in mid-run: `completed`, delivered later
H7 database gone in mid-run: `completed`, delivered later; at the start: exit code 1
H10 the gripper does not open: `completed`; no object left
C6 start elsewhere: an approach; the arm moves: `refused`
C7, C11 other cell file; plan whose motion, aim, window, certificate or id was changed: `refused`
C10 abort in any phase, also while the database is locked: `aborted`; after the end nothing
C12 a second executor of the cell: `completed`; the newcomer ends
"""
