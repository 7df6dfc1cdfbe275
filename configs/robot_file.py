"""The pydantic models of a robot file, `NAME.yaml`; `flexmotion.configs.robot` loads it with its MJCF."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from flexmotion.configs.schema import Strict
from flexmotion.configs.versions import FormatVersions

LONGEST_M = 3.0
"""Longest distance within a robot that a file may say [m]; more is written in millimetres."""
TORQUE_CUTOFF_HZ = 20.0
"""Low-pass of the accelerations from which a plan's torques are computed: rows come more than twice as often [Hz]."""
LONGEST_MOVE_S = 10.0
"""Longest way to the stand pose or to the rest pose [s]: runs end 30 s after their motion, with both ways within."""
Metres = Annotated[float, Field(ge=-LONGEST_M, le=LONGEST_M, description="[m]")]
Vector = tuple[float, float, float]
Point = tuple[Metres, Metres, Metres]
HalfExtent = Annotated[float, Field(gt=0, le=0.5, description="[m]")]
Quaternion = tuple[float, float, float, float]
Name = Annotated[str, Field(min_length=1)]

ROBOT_FILE_VERSIONS = FormatVersions(
    kind="robot file",
    oldest=1,
    newest=1,
    migration='change it as docs/drivers.md, "Versions of the robot file", says',
)


class JointConfig(Strict):
    """One joint and the servo that drives it.

    Attributes:
        name: of the joint in the MJCF.
        servo: model name in the catalogue.
        id, bus: address on the bus of that name.
        direction, zero: servo angle = direction * joint angle + zero [rad].
        limits: lowest and highest angle that is commanded [rad].
        p_gain: register value of the position gain; default: the catalogue's.
    """

    name: Name
    servo: Name
    id: int = Field(ge=0, le=252)
    bus: Name = "main"
    direction: Literal[1, -1] = 1
    zero: float = 0.0
    limits: tuple[float, float]
    p_gain: int | None = Field(default=None, gt=0)

    @model_validator(mode="after")
    def _ordered(self) -> JointConfig:
        if not self.limits[0] < self.limits[1]:
            raise ValueError(f"joint {self.name!r}: limits {list(self.limits)} must be [lower, higher]")
        return self


class Bus(Strict):
    """One servo bus.

    Attributes:
        baud: bit rate [bit/s].
        return_delay_us: time that a servo waits before it answers [us].
        watchdog_ms: servos that receive nothing for this time stop where they are [ms]; not all protocols have it.
        current_bound: whether a bound of the motor current is sent with every goal (Dynamixel: current-based position
            mode).
    """

    baud: int = Field(default=1_000_000, gt=0)
    return_delay_us: float = Field(default=0.0, ge=0)
    watchdog_ms: float = Field(default=160.0, ge=100, le=200)
    current_bound: bool = False


class Foot(Strict):
    """A foot: body, centre of the sole in the body frame [m], and usable half extents of the sole in x, y [m]."""

    body: Name
    sole: Point
    half_size: tuple[HalfExtent, HalfExtent]


class Feet(Strict):
    """Both feet."""

    left: Foot
    right: Foot


class Hand(Strict):
    """A hand: body, and the point in the body frame that hand targets refer to [m]."""

    body: Name
    point: Point


class Hands(Strict):
    """Both hands."""

    left: Hand
    right: Hand


class HeadPoint(Strict):
    """A body that the neck carries, or the torso, and the point in its frame that places of the head refer to [m]."""

    body: Name
    point: Point


class Imu(Strict):
    """The inertial measurement unit.

    Attributes:
        body: body that carries it.
        position: in the body frame [m].
        quaternion: its frame in the body frame, w x y z.
        driver: that reads it on a real robot (docs/drivers.md); None: the real robot has no IMU.
        id, bus: address, if it is on a servo bus.
        options: of its driver, such as the port if it has one of its own.
        required: whether the robot must not stream without it (otherwise it runs open loop with a warning).
    """

    body: Name
    position: Point = (0.0, 0.0, 0.0)
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
    driver: str | None = None
    id: int | None = Field(default=None, ge=0, le=252)
    bus: str | None = None
    options: dict[str, Any] = {}
    required: bool = False

    @model_validator(mode="after")
    def _unit(self) -> Imu:
        norm = sum(c * c for c in self.quaternion) ** 0.5
        if abs(norm - 1) > 1e-3:
            raise ValueError(f"quaternion {list(self.quaternion)} has norm {norm:.4g}, expected 1")
        return self


class Leg(Strict):
    """Joint names of a six-axis leg, from hip to sole."""

    hip_yaw: Name
    hip_roll: Name
    hip_pitch: Name
    knee: Name
    ankle_pitch: Name
    ankle_roll: Name


class Arm(Strict):
    """Joint names of an arm by part; the parts are free, such as `sho_pitch` and `el`, and there is at least one."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Name]

    @model_validator(mode="after")
    def _has_joints(self) -> Self:
        if not self.__pydantic_extra__:
            raise ValueError("an arm needs at least one joint")
        return self


class Head(Strict):
    """Joint names of the neck."""

    pan: Name
    tilt: Name


class Mapping(Strict):
    """The joints of each chain; `None`: the robot lacks the chain.

    A robot that follows motion has both arms, with the same number of joints; its head may be missing.
    """

    left_leg: Leg
    right_leg: Leg
    left_arm: Arm | None = None
    right_arm: Arm | None = None
    head: Head | None = None

    def chains(self) -> dict[str, Strict]:
        """The chains that the robot has, by field name."""
        return {name: chain for name, chain in self if chain is not None}


class GaitPace(Strict):
    """Greatest speeds of the human motion that this robot still follows, as measured (`benchmarks/robot/pace.py`).

    Attributes:
        ahead, back, aside: scaled to the robot's legs [m/s].
        turning: [rad/s].
        reached: greatest speed ahead of the robot itself, however fast the human goes [m/s]: "faster" is refused there.
            None, or a greater one: as `ahead`.
        curve_with_arms: share of the speed of a walked turn beside which both arms are raised or held out: they turn
            with the body, and sway it.
    """

    ahead: float = Field(gt=0)
    back: float = Field(gt=0)
    aside: float = Field(gt=0)
    turning: float = Field(gt=0)
    reached: float | None = Field(None, gt=0)
    curve_with_arms: float = Field(1.0, gt=0, le=1)


class Gait(Strict):
    """Limits of walking.

    Attributes:
        stand_hip_height, walk_hip_height: hip pitch axis above ankle pitch axis, standing and around steps [m].
        min_hip_height: lowest hip height in squats [m].
        stride_factor: step length relative to the leg-scaled human step.
        lateral: least and greatest lateral distance between the centres of the soles [m]; that with the ankles under
            the hips, in which the robot stands, is one of these.
        max_foot_yaw, max_toe_in: greatest yaw of a foot relative to the stance foot, outward and inward [rad].
        double_support_min_s: shortest double support [s].
        clearance: height of the swing foot over the floor in the middle of its way [m]: what the floor asks.
        zmp_feedback: greatest shift of the ZMP by balance feedback, along and across the feet [m].
        pace: human speeds that generated motion is limited to; None: not known, no limit.
    """

    stand_hip_height: float = Field(gt=0)
    walk_hip_height: float = Field(gt=0)
    min_hip_height: float = Field(gt=0)
    stride_factor: float = Field(gt=0, le=1.5)
    lateral: tuple[float, float]
    max_foot_yaw: float = Field(gt=0)
    max_toe_in: float = Field(gt=0)
    double_support_min_s: float = Field(ge=0)
    clearance: float = Field(gt=0)
    zmp_feedback: tuple[Annotated[float, Field(ge=0)], Annotated[float, Field(ge=0)]]
    pace: GaitPace | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Gait:
        if not self.min_hip_height <= self.walk_hip_height <= self.stand_hip_height:
            raise ValueError("expected min_hip_height <= walk_hip_height <= stand_hip_height")
        if not 0 < self.lateral[0] < self.lateral[1]:
            raise ValueError(f"lateral {list(self.lateral)} must be [least, greatest]")
        return self


UPRIGHT = 1.571
"""A quarter of a turn [rad]: a torso tilted by more lies. A greater number was meant in degrees."""

LEAST_FALL_TILT = 0.3
"""Least `fall_tilt` that is accepted [rad]: walks alone lean by up to 0.24."""

DEEPEST_BOW = 1.25
"""Greatest tilt that a plan may have [rad]: with `PAST_PLAN_RAD` more a robot does not lie yet."""

_FALL_MARGIN = 0.085
"""What plans keep from the tilt that counts as a fall, where the file says nothing [rad]: bends overshoot by up to 2
degrees, and floors slope."""

EmergencyStop = Literal["freeze", "captured_stop", "crouch"]
"""What an emergency stop does at first; then the robot parks, and its torque goes off.

freeze: the goals stay as they are, inside the envelope. captured_stop: the plan's own balanced stop. crouch: the way to
the rest pose begins at once, from whatever pose it is in.
"""


class SafetyLimits(Strict):
    """Thresholds at which the ladder acts.

    Attributes:
        max_stale_reads: consecutive reads that a servo may miss before FAULT.
        fall_tilt: torso tilt that counts as a fall of a robot that is to be upright, at most a right angle [rad]. One
            that bows falls where it is tilted further than its plan (`flexmotion/spatial/tilt.py`).
        bow_tilt: greatest torso tilt of a plan [rad]; by default 0.085 less than `fall_tilt`. More needs a proof that
            the robot stands up again (`benchmarks/robot/bows.py`).
        voltage_min: supply below which the robot parks [V].
        thermal_margin: a servo this close to its own shutdown parks the robot; at twice this margin it warns [°C].
        lost_bus_hold_s: how long a robot whose servos do not answer is held before it is lowered without measurements,
            where `emergency_stop` is "freeze" [s].
        blocked_hold_s: how long a robot with a blocked leg stands frozen, for somebody to hold it, before it is
            lowered, where `emergency_stop` is "freeze" [s].
        park_s: duration of the motion to the rest pose [s].
        soft_start_speed: greatest joint speed on the way to the stand pose [rad/s]; the way from the rest pose takes
            `LONGEST_MOVE_S` at most.
        standing_margin: how far outside its limits a joint may be when torque goes on [rad]: a limp robot sags onto its
            stops. The servos' own limits are set this much wider, so that goals can be pinned there.
        emergency_stop: see `EmergencyStop`. "freeze" and "crouch" need a proof that the robot stays up at every phase
            of a step (`benchmarks/robot/emergency_stop.py`); without one it is the stop that balances itself.
    """

    max_stale_reads: int = Field(default=5, ge=1)
    fall_tilt: float = Field(default=0.785, ge=LEAST_FALL_TILT, le=UPRIGHT, description="[rad]")
    bow_tilt: float | None = Field(default=None, gt=0, le=DEEPEST_BOW, description="[rad]")
    voltage_min: float | None = Field(default=None, gt=0)
    thermal_margin: float = Field(default=5.0, ge=0)
    lost_bus_hold_s: float = Field(default=1.0, ge=0, le=10)
    blocked_hold_s: float = Field(default=30.0, ge=0, le=600)
    park_s: float = Field(default=2.0, gt=0, le=LONGEST_MOVE_S, description="[s]")
    soft_start_speed: float = Field(default=0.8, gt=0)
    standing_margin: float = Field(default=0.15, ge=0, le=UPRIGHT, description="[rad]")
    emergency_stop: EmergencyStop = "captured_stop"

    @property
    def most_tilt(self) -> float:
        """Greatest torso tilt of a plan [rad]."""
        return self.fall_tilt - _FALL_MARGIN if self.bow_tilt is None else self.bow_tilt


class RobotFile(Strict):
    """The whole robot file.

    Attributes:
        version: of the file format; a file without this field has version 1.
        rate_hz: cycles of the loop, and rows of a plan, a second.
        least_stiffness: least share of their stiffness with which arms and head follow: where the human's limb is not
            tense, or a tension of 0 is asked; 1: they always have all of it (`benchmarks/robot/tension.py`).
        hands: a robot that follows motion has them.
        head: None: the head of this robot cannot be asked to be at a place.
    """

    version: int = 1
    name: Name
    description: str
    mjcf: Name
    rate_hz: float = Field(gt=2 * TORQUE_CUTOFF_HZ, le=2000, description="[Hz]")
    torso: Name
    imu: Imu | None = None
    buses: dict[str, Bus] = Field(default_factory=lambda: {"main": Bus()})
    joints: list[JointConfig] = Field(min_length=1)
    feet: Feet
    hands: Hands | None = None
    head: HeadPoint | None = None
    mapping: Mapping
    stand_pose: dict[str, float]
    rest_pose: dict[str, float]
    gait: Gait
    least_stiffness: float = Field(default=1.0, ge=0.1, le=1.0)
    safety: SafetyLimits = SafetyLimits()
