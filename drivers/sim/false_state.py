"""`falsify`: false readings in the state of a simulated robot, the same that emulated servos report."""

from __future__ import annotations

from flexmotion.configs.robot import Robot
from flexmotion.drivers.emulator.false_readings import FalseReadings
from flexmotion.drivers.interface import RobotState


def falsify(false: FalseReadings, robot: Robot, state: RobotState) -> None:
    """Add the errors that are due to what was measured, in place. The simulated servos themselves know the truth.

    Errors of a servo are in its own direction and units (`flexmotion.drivers.emulator.false_readings.ServoError`).
    """
    for joint in range(robot.n):
        error = false.of_servo(joint)
        if error is None:
            continue
        direction = robot.direction[joint]
        state.position[joint] += direction * error.position * robot.tick_rad[joint]
        state.velocity[joint] += direction * error.speed
        state.effort[joint] += direction * error.torque
        state.voltage[joint] += error.voltage
        state.temperature[joint] += error.temperature
    if state.imu_stale < 0:
        return
    wrong = false.of_imu()
    if wrong is not None:
        state.gyro += wrong.gyro
        state.accel += wrong.accel
