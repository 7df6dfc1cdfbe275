"""Options of the simulated robot: start pose, sensors, and mismatch against its model."""

from __future__ import annotations

from typing import Any, Literal, Self

from pydantic import Field, model_validator

from flexmotion.configs.robot_file import Vector
from flexmotion.configs.schema import Strict

BUS_S = 0.003
"""Time that a goal and the read before it take on the bus: about that of twenty servos at 2 Mbaud (assumption) [s]."""


class Push(Strict):
    """A push at the torso's centre of mass: time [s], impulse in the world frame [N·s], spread over `duration` [s]."""

    at: float = Field(ge=0)
    impulse: Vector
    duration: float = Field(default=0.1, gt=0)


class RandomPushes(Strict):
    """Horizontal pushes in random directions: one every `every_s` [s], of `impulse` [N·s] over `duration` [s]."""

    every_s: float = Field(gt=0)
    impulse: float = Field(gt=0)
    duration: float = Field(default=0.1, gt=0)


class Plate(Strict):
    """A fixed plate in the way, square and 2 cm thick.

    Attributes:
        position: centre of its face in the world [m].
        normal: out of that face, of any length above 0.
        half_size: half the length of its sides [m].
    """

    position: Vector
    normal: Vector
    half_size: float = Field(default=0.05, gt=0)

    @model_validator(mode="after")
    def _has_a_side(self) -> Self:
        if not any(self.normal):
            raise ValueError("normal is [0, 0, 0], expected a direction")
        return self


class SimOptions(Strict):
    """Options of driver `sim`. The defaults are the robot as its file describes it.

    Attributes:
        seed: of sensor noise, biases and random pushes; runs with equal seeds are identical, bit for bit.
        timestep: physics step [s].
        start: pose at `open`, feet on the floor.
        suspended: the torso is held all the time, feet in the air.
        held: the torso is held until torque is first switched on; otherwise the robot collapses.
        picked_up_s: this long after all torque has gone off, the robot is back in its start pose where it began, its
            torso held until torque goes on, as if somebody had set it up [s]; None: it stays where it sank down. One
            that has fallen, also since its torque was cut, onto a side from which it can get up stays there all the
            same.
        command_delay_s: time from `write` to the servos acting, as the driver reports it [s]; None: `BUS_S` plus the
            servos' own delay.
        read_delay_s: age of what `read` returns [s]; assumption, as above.
        imu: whether there is one (without `imu` in the robot file there is none).
        noise_scale: multiplies noise and bias of every sensor.
        gyro_noise, gyro_bias: standard deviation of the white noise of a sample and of the constant bias [rad/s].
        accel_noise, accel_bias: the same of the accelerometer [m/s²].
        imu_bandwidth_hz: of the sensor's low-pass [Hz]; noise and bandwidth are typical of consumer parts (assumption).
        voltage: of the supply without load [V]; default: the servos' nominal voltage.
        supply_resistance: of battery and wiring [Ohm]; 0: no voltage drop.
        mass_scale, torso_mass_scale: multiply masses and inertias.
        total_mass: mass of the robot [kg]; the mass of the torso is changed to reach it.
        kp_scale: multiplies servo stiffness.
        extra_latency_s: added to the command delay [s], and not reported by the driver.
        friction: sliding friction of floor and soles.
        joint_friction_scale: multiplies dry friction in the joints.
        slope_deg: tilt of the floor about y (uphill is negative) and x [deg].
        false_readings: share of readings, of servos and IMU, that are false at random, as on the emulated bus
            (`flexmotion.drivers.random_errors`).
        pushes, random_pushes: pushes at the torso.
        plates: fixed plates that are in the robot's way.
    """

    seed: int = Field(default=0, ge=0)
    timestep: float = Field(default=0.002, gt=0, le=0.01)
    start: Literal["stand", "rest"] = "stand"
    suspended: bool = False
    held: bool = True
    picked_up_s: float | None = Field(default=None, gt=0)

    command_delay_s: float | None = Field(default=None, ge=0, le=0.1)
    read_delay_s: float = Field(default=0.004, ge=0, le=0.1)

    imu: bool = True
    noise_scale: float = Field(default=1.0, ge=0)
    gyro_noise: float = Field(default=0.003, ge=0)
    gyro_bias: float = Field(default=0.003, ge=0)
    accel_noise: float = Field(default=0.04, ge=0)
    accel_bias: float = Field(default=0.05, ge=0)
    imu_bandwidth_hz: float = Field(default=90.0, gt=0)

    voltage: float | None = Field(default=None, gt=0)
    supply_resistance: float = Field(default=0.0, ge=0)

    mass_scale: float = Field(default=1.0, gt=0)
    torso_mass_scale: float = Field(default=1.0, gt=0)
    total_mass: float | None = Field(default=None, gt=0)
    kp_scale: float = Field(default=1.0, gt=0)
    extra_latency_s: float = Field(default=0.0, ge=0, le=0.1)
    friction: float | None = Field(default=None, gt=0)
    joint_friction_scale: float = Field(default=1.0, ge=0)
    slope_deg: tuple[float, float] = (0.0, 0.0)
    false_readings: float = Field(default=0.0, ge=0, le=1)
    pushes: tuple[Push, ...] = ()
    random_pushes: RandomPushes | None = None
    plates: tuple[Plate, ...] = ()


PERTURBED = SimOptions(
    torso_mass_scale=1.12,
    extra_latency_s=0.005,
    kp_scale=0.92,
    friction=0.6,
    slope_deg=(0.8, 0.0),
    random_pushes=RandomPushes(every_s=3.0, impulse=0.2),
)
"""The mismatch of robustness tests."""


def standard_options(perturbed: bool) -> dict[str, Any]:
    """Options of driver `sim` by name: those of `PERTURBED`, or none."""
    return PERTURBED.model_dump(mode="json", exclude_unset=True) if perturbed else {}
