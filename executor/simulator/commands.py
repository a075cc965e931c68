"""The commands of `rtde_control`: what the script does with each number of input integer register 0."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from executor.simulator.control_program import ControlProgram
from executor.simulator.move_commands import MOVES
from executor.simulator.program import ProgramError, Thread
from executor.simulator.queries import QUERIES
from executor.simulator.setup_commands import SETTINGS
from executor.simulator.touch_commands import TOUCHES

Command = Callable[[ControlProgram], Iterator[None] | None]

COMMANDS: dict[int, Command] = {**MOVES, **TOUCHES, **SETTINGS, **QUERIES}
ARGUMENTS = {  # command -> double registers the script reads for it, from 0 on; none where it is not named
    1: 8, 2: 8, 3: 8, 4: 8, 9: 8, 10: 8, 11: 11, 24: 11, 12: 9, 15: 1, 16: 1, 33: 1, 34: 1, 17: 4, 65: 10, 29: 6, 59: 3,
    35: 1, 25: 6, 30: 14, 46: 6, 60: 6, 61: 14, 36: 6, 37: 6, 39: 12, 41: 14, 44: 12, 51: 13, 62: 6,
}  # fmt: skip


def process(program: ControlProgram, number: int) -> Thread | None:
    """Carries out one command, or returns what is left to do of it; an unknown number is nothing, as in the script.

    Raises:
        ProgramError: an argument is not finite.
    """
    if not all(map(math.isfinite, program.doubles_in(0, ARGUMENTS.get(number, 0)))):
        raise ProgramError(f"command {number}: an argument is not finite")
    command = COMMANDS.get(number)
    return command(program) if command else None
