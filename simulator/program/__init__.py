"""The program side: the uploaded control program, its commands and motions, its life, safety state and stops.

Arm, registers and timeline are handed in; nothing here knows a socket.
"""

from simulator.program import messages, motions
from simulator.program.commands import load_control_program
from simulator.program.context import Installation, MotionState, ProgramContext, Registers
from simulator.program.control_program import HEADER as CONTROL_HEADER
from simulator.program.interpreter_queue import InterpreterQueue
from simulator.program.runner import PAUSED, PLAYING, STOPPED, ProgramRunner
from simulator.program.safety import SafetyLimits, SafetyState
from simulator.program.stops import PROGRAM_FATES, Stops
from simulator.program.threads import Program, ProgramError, SuddenTargetChange, Thread

__all__ = [
    "CONTROL_HEADER",
    "PAUSED",
    "PLAYING",
    "PROGRAM_FATES",
    "STOPPED",
    "Installation",
    "InterpreterQueue",
    "MotionState",
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
