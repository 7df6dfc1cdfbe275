"""`falsify`: false readings in the state of a simulated robot, the same that emulated servos report."""

from __future__ import annotations

from flexmotion.configs.robot import Robot
from flexmotion.drivers.interface import RobotState
from flexmotion.drivers.random_errors import ImuError, RandomErrors, ServoError


def falsify(errors: RandomErrors, robot: Robot, state: RobotState) -> None:
    """Add the errors that are due to what was measured, in place. The simulated servos themselves know the truth."""
    for joint in range(robot.n):
        if errors.due():
            error = ServoError()
            errors.of_servo(error)
            direction = robot.direction[joint]
            state.position[joint] += direction * error.position * robot.tick_rad[joint]
            state.velocity[joint] += direction * error.speed
            state.effort[joint] += direction * error.torque
            state.voltage[joint] += error.voltage
            state.temperature[joint] += error.temperature
    if state.imu_stale >= 0 and errors.due():
        wrong = ImuError()
        errors.of_imu(wrong)
        state.gyro += wrong.gyro
        state.accel += wrong.accel
