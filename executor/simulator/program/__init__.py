"""The program side: the uploaded control program, its commands and motions, its life, safety state and stops.

Arm, registers and timeline are handed in; nothing here knows a socket.
"""

from executor.simulator.program import messages, motions
from executor.simulator.program.commands import load_control_program
from executor.simulator.program.context import Installation, ProgramContext, Registers
from executor.simulator.program.control_program import HEADER as CONTROL_HEADER
from executor.simulator.program.runner import PAUSED, PLAYING, STOPPED, ProgramRunner
from executor.simulator.program.safety import SafetyLimits, SafetyState
from executor.simulator.program.stops import PROGRAM_FATES, Stops
from executor.simulator.program.threads import Program, ProgramError, SuddenTargetChange, Thread

__all__ = [
    "CONTROL_HEADER",
    "PAUSED",
    "PLAYING",
    "PROGRAM_FATES",
    "STOPPED",
    "Installation",
    "Program",
    "ProgramContext",
    "ProgramError",
    "ProgramRunner",
    "Registers",
    "SafetyLimits",
    "SafetyState",
    "Stops",
    "SuddenTargetChange",
    "Thread",
    "load_control_program",
    "messages",
    "motions",
]
