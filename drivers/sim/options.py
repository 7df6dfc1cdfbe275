"""What may be set about the simulated robot: its start, its sensors, and how it differs from its model."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from flexmotion.configs.robot_file import Vector
from flexmotion.configs.schema import Strict


class Push(Strict):
    """A shove at the torso's centre of mass: when [s], impulse in the world [N·s], spread over `duration` [s]."""

    at: float = Field(ge=0)
    impulse: Vector
    duration: float = Field(default=0.1, gt=0)


class RandomPushes(Strict):
    """Horizontal shoves in random directions: one every `every_s` [s] of `impulse` [N·s] over `duration` [s]."""

    every_s: float = Field(gt=0)
    impulse: float = Field(gt=0)
    duration: float = Field(default=0.1, gt=0)


class SimOptions(Strict):
    """Options of driver `sim`. What is not given is the robot as its file describes it.

    Attributes:
        seed: of sensor noise, biases and random pushes; equal seeds give equal runs, bit for bit.
        timestep: of the physics [s].
        start: pose at `open`, feet on the floor.
        suspended: hung up by the torso, feet in the air, all the time.
        held: before torque is first switched on someone holds the torso; without it the robot collapses.
        command_delay_s: from `write` to the servos acting, as the driver reports it; an assumption of bus time at
            2 Mbaud and the servo's own cycle.
        read_delay_s: age of what `read` returns; an assumption likewise.
        imu: whether there is one (a robot file without `imu` has none in any case).
        noise_scale: multiplies noise and bias of every sensor.
        gyro_noise, gyro_bias: standard deviation of white noise a sample, and of the constant offset [rad/s].
        accel_noise, accel_bias: likewise [m/s²].
        imu_bandwidth_hz: of the sensor's own low-pass; noise and bandwidth are typical of consumer parts (assumption).
        voltage: of the supply at no current [V]; the servos' nominal voltage where not given.
        supply_resistance: of battery and wiring [Ohm]; sag is off by default.
        mass_scale, torso_mass_scale: multiply masses and inertias.
        total_mass: the torso is made heavier (or lighter) until the robot has it [kg].
        kp_scale: multiplies servo stiffness.
        extra_latency_s: added to the command delay, and not reported.
        friction: sliding friction of floor and soles.
        joint_friction_scale: multiplies dry friction in the joints.
        slope_deg: tilt of the floor about y (uphill is negative) and x [deg].
        pushes, random_pushes: shoves.
    """

    seed: int = Field(default=0, ge=0)
    timestep: float = Field(default=0.002, gt=0, le=0.01)
    start: Literal["stand", "rest"] = "stand"
    suspended: bool = False
    held: bool = True

    command_delay_s: float = Field(default=0.004, ge=0, le=0.1)
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
    pushes: tuple[Push, ...] = ()
    random_pushes: RandomPushes | None = None


PERTURBED = SimOptions(
    torso_mass_scale=1.12,
    extra_latency_s=0.005,
    kp_scale=0.92,
    friction=0.6,
    slope_deg=(0.8, 0.0),
    random_pushes=RandomPushes(every_s=3.0, impulse=0.2),
)
"""The mismatch that robustness is tested with."""
