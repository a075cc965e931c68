"""What of a controller RTDE neither tells nor does: remote control, serial number, power, brakes, protective stops.

CB3 and PolyScope 5 have the dashboard for it, PolyScope X has the Robot API. Whichever answers is used; where neither
does, a person does it on the pendant. No stop depends on either (docs/decisions/0028-any-controller.md).
"""

from __future__ import annotations

import time
from typing import Protocol

from executor.robot.dashboard import DashboardClient
from executor.robot.operation import ActionRefused, ControlMode
from executor.robot.robot_api import RobotApiClient
from store import RobotAction

RETRY_S = 2.0  # [s] after which it is looked again for an interface of a controller that had none
PENDANT: dict[RobotAction, str] = {  # action -> what a person does instead
    "power_on": "open the robot's state at the bottom left and switch the arm on",
    "brake_release": "open the robot's state at the bottom left and start the arm: its brakes release",
    "unlock_protective_stop": "look for the cause, then confirm in the message of the protective stop",
    "power_off": "open the robot's state at the bottom left and switch the arm off",
}


class OperationInterface(Protocol):
    """An interface that operates an arm. Every method raises OSError where it does not answer."""

    name: str

    def connect(self) -> None:
        """Checks that it is there."""
        ...

    def control_mode(self) -> ControlMode:
        """Returns who controls the robot."""
        ...

    def serial_number(self) -> str | None:
        """Returns the robot's serial number; None where this version does not tell it."""
        ...

    def act(self, action: RobotAction) -> None:
        """Operates the robot.

        Raises:
            ActionRefused: the controller refuses it, in its words.
        """
        ...

    def close(self) -> None:
        """Closes its connection, if any."""
        ...


class Console:
    """Whichever of its interfaces a controller offers, looked for when first needed. Not safe for two threads.

    Attributes:
        interface: the one that answered last; None while none does.
    """

    def __init__(self, host: str) -> None:
        self.host = host
        self.interface: OperationInterface | None = None
        self._look_at = 0.0

    def control_mode(self) -> ControlMode | None:
        """Returns who controls the robot; None where nothing answers."""
        interface = self._found()
        try:
            return None if interface is None else interface.control_mode()
        except OSError:
            self.close()
            return None

    def serial_number(self) -> str | None:
        """Returns the robot's serial number; None without an answer, and from a version that does not tell it."""
        interface = self._found()
        try:
            return None if interface is None else interface.serial_number()
        except OSError:
            self.close()
            return None

    def act(self, action: RobotAction) -> str:
        """Operates the robot; returns by which interface.

        Raises:
            ActionRefused: the controller refuses it, or a person has to do it, in words.
        """
        self._look_at = 0.0  # a person waits
        interface = self._found()
        if interface is None:
            missing = f"neither dashboard nor Robot API answers at {self.host}"
            raise ActionRefused(f"{missing}; on the pendant: {PENDANT[action]}")
        try:
            interface.act(action)
        except OSError as error:
            self.close()
            raise ActionRefused(f"the {interface.name} at {self.host}: {error}") from error
        return interface.name

    def close(self) -> None:
        """Closes the connection, if any; the next question looks for an interface again."""
        if self.interface is not None:
            self.interface.close()
            self.interface = None

    def _found(self) -> OperationInterface | None:
        if self.interface is None and time.monotonic() >= self._look_at:
            self.interface = find_interface(self.host)
            self._look_at = time.monotonic() + RETRY_S
        return self.interface


def find_interface(host: str) -> OperationInterface | None:
    """Returns the interface that the controller at `host` offers, connected; None without one."""
    candidates: tuple[OperationInterface, ...] = (DashboardClient(host), RobotApiClient(host))
    for candidate in candidates:
        try:
            candidate.connect()
            return candidate
        except OSError:
            candidate.close()
    return None
