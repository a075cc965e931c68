"""Settings of the simulated controller beyond the cell file: every number of its behaviour, with its source.

Values of a real controller that could not be measured are marked "chosen"; docs/simulator.md says what follows from
them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

RTDE_PORT = 30004  # source: UR RTDE guide
PRIMARY_PORT = 30001
SECONDARY_PORT = 30002  # source: UR client interfaces
SCRIPT_PORT = 30003  # source: UR client interfaces, the real-time interface; ur_rtde uploads its program here
INTERPRETER_PORT = 30020  # source: UR, "Interpreter mode"; e-Series only
READ_ONLY = 10  # added to a port's number: the same to read from only; source: UR client interfaces
DASHBOARD_PORT = 29999  # source: UR dashboard manual; PolyScope X has none
ROBOT_API_PORT = 80  # source: UR's client library, `DashboardClientImplX`
ROBOT_API_SPARE_PORT = 29980  # chosen: instead of 80, where this user may not listen on that, or somebody else does
POLYSCOPE_X_MAJOR = 10
ROBOT_API_SINCE = (10, 11)  # source: UR, release note of PolyScope X 10.11
CONTROL_PORT = 29900  # chosen: the simulator's own, not a port of UR
CAMERA_PORT = 29901  # chosen: of the camera above a feeder, likewise

BIT_REGISTERS = 128  # general purpose bits, input and output; source: RTDE guide
BIT_WORDS_END = 64  # the bits below are read and written as two words of 32; source: RTDE guide
REGISTERS = 48  # general purpose registers of each kind, input and output; source: RTDE guide


@dataclass(frozen=True)
class Decelerations:
    """Decelerations of the leading axis [rad/s^2] that bring the arm to rest without a command."""

    program_end: float = 30.0  # chosen: as an emergency stop; neither published nor measured
    protective_stop: float = 20.0  # chosen: category 2, 3 rad/s to rest in 150 ms
    safeguard_stop: float = 20.0  # chosen: category 2 as well
    emergency_stop: float = 30.0  # chosen: category 1, 3 rad/s to rest in 100 ms
    power_loss: float = 40.0  # chosen: category 0, the brakes; the hardest of all


@dataclass(frozen=True)
class ControllerIdentity:
    """Identity the controller presents to its clients: PolyScope version, build, serial number, robot model."""

    version: tuple[int, int, int]
    build: int
    serial_number: str
    model: str


@dataclass(frozen=True)
class SimulatorSettings:
    """Behaviour of the simulated controller that no cell file describes.

    Attributes:
        programs: folder of stored programs; None: there are none.
    """

    decelerations: Decelerations = Decelerations()
    position_noise_rad: float = 5e-6  # chosen: standard deviation of the measured joint position
    velocity_noise_rad_s: float = 5e-4  # chosen: standard deviation of the measured joint speed
    program_start_s: float = 0.05  # chosen: from the upload to "playing"; ur_rtde waits up to 5 s for it
    protective_stop_lock_s: float = 5.0  # source: UR dashboard manual, "Cannot unlock ... until 5s after occurrence"
    protective_stop_runtime: str = "paused"  # source: UR forum 6634: the program is paused
    joint_speed_tolerance_rad_s: float = 0.192  # source: UR user manual, safety limits: 191 deg/s for a 180 deg/s joint
    tcp_speed_limit_m_s: float = 5.0  # source: UR user manual, the largest tool speed a safety setup accepts
    torque_every_s: float = 0.1  # chosen: joint torques are expensive, so they are computed at 10 Hz and held
    restitution: float = 0.0  # chosen: an object stays where it lands; above 0 it bounces and lands again
    serial_number: str = "20235500001"  # chosen: digits only, as ur_rtde requires
    build: int = 123456  # chosen
    programs: Path | None = None
    remote_control_enabled: bool = True  # False as on a new robot and on URSim: not in remote control, nothing refused
    stall_tolerant: bool = True  # controller time slips where the machine stalls; False: a strict grid of cycles
