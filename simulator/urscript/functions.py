"""All functions that scripts may call: moves, state, messages, mathematics.

Source of names and parameters: Universal Robots, "The URScript Programming Language".
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from typing import Any

from simulator.physics import kinematics
from simulator.program import ProgramContext, messages
from simulator.urscript.motion_functions import MOTION_FUNCTIONS
from simulator.urscript.signatures import Signature, signature
from simulator.urscript.socket_functions import SOCKET_FUNCTIONS
from simulator.urscript.state_functions import STATE_FUNCTIONS
from simulator.urscript.values import ScriptPose, number, written

TEXT_MAX = 1000  # [characters] chosen: a longer text of a program is cut off
POPUP_TITLE = "Popup"  # source: URScript manual, popup's default title


def _text(*values: Any) -> str:
    return "".join(map(written, values))[:TEXT_MAX]


def _say(c: ProgramContext, s1: Any, s2: Any) -> None:
    c.post(messages.TextMessage(_text(s1, s2)))


def _number(text: str) -> float:
    return int(text) if text.strip().lstrip("+-").isdigit() else float(text)


def _place(text: Any, index: Any) -> int:
    """Returns the index of a character.

    Raises:
        ValueError: there is none.
    """
    place = int(number(index))
    if not 0 <= place < len(str(text)):
        raise ValueError("index out of bounds")
    return place


def _part(c: ProgramContext, text: Any, index: Any, length: Any) -> str:
    rest = str(text)[_place(text, index) :]
    return rest if number(length) < 0 else rest[: int(length)]


def _popup(c: ProgramContext, s: Any, title: Any, warning: Any, error: Any, blocking: Any) -> None:
    flags = (warning is True, error is True, blocking is True)
    c.post(messages.Popup(_text(title) if isinstance(title, str) else POPUP_TITLE, _text(s), *flags))


def _product(c: ProgramContext, a: Any, b: Any) -> ScriptPose:
    return ScriptPose(kinematics.pose_of(kinematics.product(*(kinematics.transform(ScriptPose(p)) for p in (a, b)))))


def _sum(c: ProgramContext, a: Any, b: Any) -> ScriptPose:
    """Returns the sum of two positions, with the product of the rotations: those of `b` are about the base's axes."""
    first = ScriptPose(a)
    second = ScriptPose(b)
    turned = kinematics.product(
        kinematics.transform([0.0, 0.0, 0.0, *second[3:]]), kinematics.transform([0.0, 0.0, 0.0, *first[3:]])
    )
    place = [x + y for x, y in zip(first[:3], second[:3], strict=True)]
    return ScriptPose([*place, *kinematics.rotation_vector(turned)])


def _inverse(c: ProgramContext, a: Any) -> ScriptPose:
    return ScriptPose(kinematics.pose_of(kinematics.inverse(kinematics.transform(ScriptPose(a)))))


def _norm(c: ProgramContext, a: Any) -> float:
    return math.hypot(*map(number, a)) if isinstance(a, list) else abs(number(a))


def _plain(function: Callable[..., float], parameters: str = "f") -> Signature:
    """Returns a function of numbers."""
    return signature(parameters, lambda c, *values: function(*map(number, values)))


MESSAGE_FUNCTIONS: dict[str, Signature] = {
    "textmsg": signature("s1 s2=", _say),
    "popup": signature("s title=0 warning=0 error=0 blocking=0", _popup),
    "protective_stop": signature("", lambda c: c.protective_stop("triggered by the program")),
    "to_str": signature("val", lambda c, val: _text(val)),
    "to_num": signature("str", lambda c, text: _number(str(text))),
    "str_cat": signature("op1 op2", lambda c, op1, op2: _text(op1, op2)),
    "str_len": signature("str", lambda c, text: len(str(text))),
    "str_empty": signature("str", lambda c, text: not str(text)),
    "str_at": signature("src index", lambda c, text, index: str(text)[_place(text, index)]),
    "str_sub": signature("src index len=-1", _part),
    "str_find": signature("src target start_from=0", lambda c, text, target, at: str(text).find(str(target), int(at))),
}
INTERPRETER_FUNCTIONS: dict[str, Signature] = {  # `interpreter_mode` itself is run by the script
    "interpreter_mode": signature("clearQueueOnEnter=1 clearOnEnd=1", lambda c, queue, end: None, waits=True),
    "end_interpreter": signature("", lambda c: c.interpreter.end()),
    "clear_interpreter": signature("", lambda c: c.interpreter.clear()),
}
MATHEMATICS: dict[str, Signature] = {
    "pose_trans": signature("p_from p_from_to", _product),
    "pose_add": signature("p_1 p_2", _sum),
    "pose_inv": signature("p_from", _inverse),
    "norm": signature("a", _norm),
    "length": signature("v", lambda c, v: len(v)),
    "get_list_length": signature("v", lambda c, v: len(v)),
    "random": signature("", lambda c: random.random()),
    "sqrt": _plain(math.sqrt),
    "sin": _plain(math.sin),
    "cos": _plain(math.cos),
    "tan": _plain(math.tan),
    "asin": _plain(math.asin),
    "acos": _plain(math.acos),
    "atan": _plain(math.atan),
    "atan2": _plain(math.atan2, "x y"),
    "pow": _plain(math.pow, "base exponent"),
    "log": _plain(lambda b, f: math.log(f, b), "b f"),
    "floor": _plain(math.floor),
    "ceil": _plain(math.ceil),
    "d2r": _plain(math.radians, "d"),
    "r2d": _plain(math.degrees, "r"),
}
FUNCTIONS: dict[str, Signature] = (
    MOTION_FUNCTIONS | STATE_FUNCTIONS | SOCKET_FUNCTIONS | MESSAGE_FUNCTIONS | INTERPRETER_FUNCTIONS | MATHEMATICS
)
SINCE = {  # function -> generation -> first version that has it; source: URScript manuals
    "optimovej": {5: (5, 21), 10: (10, 8)},
    "optimovel": {5: (5, 21), 10: (10, 8)},
    "force_mode_set_gain_scaling": {5: (5, 0), 10: (10, 0)},
    "set_target_payload": {5: (5, 10), 10: (10, 0)},
    "direct_torque": {5: (5, 23), 10: (10, 11)},
    **{name: {5: (5, 0), 10: (10, 0)} for name in INTERPRETER_FUNCTIONS},
}
NEVER = (99, 0)


def functions_of(version: tuple[int, ...]) -> dict[str, Signature]:
    """Returns the functions that a controller of a version has, by name."""

    def exists(name: str) -> bool:
        return name not in SINCE or version[:2] >= SINCE[name].get(version[0], NEVER)

    return {name: function for name, function in FUNCTIONS.items() if exists(name)}
