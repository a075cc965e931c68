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
from simulator.urscript.state_functions import STATE_FUNCTIONS
from simulator.urscript.values import ScriptPose, number, written

TEXT_MAX = 1000  # [characters] chosen: a longer text of a program is cut off
POPUP_TITLE = "Popup"  # source: URScript manual, popup's default title


def _text(*values: Any) -> str:
    return "".join(written(value) for value in values if value != "")[:TEXT_MAX]


def _say(c: ProgramContext, s1: Any, s2: Any) -> None:
    c.post(messages.TextMessage(_text(s1, "" if s2 == 0.0 else s2)))


def _popup(c: ProgramContext, s: Any, title: Any, warning: Any, error: Any, blocking: Any) -> None:
    flags = (warning is True, error is True, blocking is True)
    c.post(messages.Popup(_text(title) if isinstance(title, str) else POPUP_TITLE, _text(s), *flags))


def _product(c: ProgramContext, a: Any, b: Any) -> ScriptPose:
    return ScriptPose(kinematics.pose_of(kinematics.product(*(kinematics.transform(ScriptPose(p)) for p in (a, b)))))


def _inverse(c: ProgramContext, a: Any) -> ScriptPose:
    return ScriptPose(kinematics.pose_of(kinematics.inverse(kinematics.transform(ScriptPose(a)))))


def _norm(c: ProgramContext, a: Any) -> float:
    return math.hypot(*map(number, a)) if isinstance(a, list) else abs(number(a))


def _plain(function: Callable[..., float], parameters: str = "f") -> Signature:
    """Returns a function of numbers."""
    return signature(parameters, lambda c, *values: function(*map(number, values)))


MESSAGE_FUNCTIONS: dict[str, Signature] = {
    "textmsg": signature("s1 s2=0", _say),
    "popup": signature("s title=0 warning=0 error=0 blocking=0", _popup),
    "protective_stop": signature("", lambda c: c.protective_stop("triggered by the program")),
    "to_str": signature("val", lambda c, val: _text(val)),
    "str_cat": signature("op1 op2", lambda c, op1, op2: _text(op1, op2)),
}
MATHEMATICS: dict[str, Signature] = {
    "pose_trans": signature("p_from p_from_to", _product),
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
FUNCTIONS: dict[str, Signature] = MOTION_FUNCTIONS | STATE_FUNCTIONS | MESSAGE_FUNCTIONS | MATHEMATICS
