"""What the functions of a script may use: the controller's parts, and what is the script's own."""

from __future__ import annotations

from dataclasses import dataclass, field

from simulator.program import ProgramContext
from simulator.urscript.sockets import ScriptSockets


@dataclass(frozen=True)
class ScriptContext(ProgramContext):
    """Context of one script.

    Attributes:
        sockets: connections that the script opened.
    """

    sockets: ScriptSockets = field(default_factory=ScriptSockets)
