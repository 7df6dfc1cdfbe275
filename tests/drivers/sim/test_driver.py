from __future__ import annotations

import shutil
from collections.abc import Callable

import mujoco
import numpy as np
import pytest
import yaml

from flexmotion.configs.robot import ROBOTS, Robot, load_robot
from flexmotion.drivers.sim.driver import OVERHEATED, SimDriver
from flexmotion.drivers.sim.options import PERTURBED, SimOptions

STANDING_HEIGHT = 0.26


def test_it_stands_still_on_bent_knees(start: Callable, op3: Robot) -> None:
    run = start()
    run.tick(250)
    truth = run.driver.truth()
    assert truth.base_position[2] == pytest.approx(STANDING_HEIGHT, abs=0.005)
    assert run.tilt < 0.06
    assert truth.foot_force[:, 2].sum() == pytest.approx(op3.mass * 9.81, rel=0.01)
    np.testing.assert_allclose(truth.foot_position[:, 2], 0.0, atol=1e-3)
    assert np.abs(truth.foot_velocity).max() < 1e-3
    assert np.abs(run.state.position - op3.stand_pose).max() < 0.06  # droop of the position loop
    assert not truth.self_contact and not truth.saturated.any()
    assert run.driver.violations == 0


def standing_torque(robot: Robot) -> np.ndarray:
    """Joint torques in the stand pose with half the weight on each sole's centre, (n,): gravity minus J^T f."""
    model, data = robot.model, mujoco.MjData(robot.model)
    data.qpos[robot.qpos_address] = robot.stand_pose
    mujoco.mj_forward(model, data)
    torque = data.qfrc_bias.copy()
    jacobian = np.zeros((3, model.nv))
    for foot, sole in zip(robot.foot_ids, robot.soles, strict=True):
        point = data.xpos[foot] + data.xmat[foot].reshape(3, 3) @ sole
        mujoco.mj_jac(model, data, jacobian, None, point, foot)
        torque -= jacobian.T @ [0, 0, robot.mass * 9.81 / 2]
    return torque[robot.dof_address]


def test_feed_forward_of_gravity_torque_removes_the_droop(start: Callable, op3: Robot) -> None:
    run = start(noise_scale=0.0)
    run.command.position[:] = op3.stand_pose + standing_torque(op3) / op3.kp
    run.tick(250)
    assert np.abs(run.driver.truth().joint_position - op3.stand_pose).max() < 0.005
    assert run.tilt < 0.01


@pytest.mark.parametrize(
    "options",
    [{"joint_friction_scale": scale} for scale in (0.3, 1.0, 3.0)]
    + [{"friction": 0.6}, {"slope_deg": (1.0, 1.0)}, {"slope_deg": (-1.0, 1.0)}, PERTURBED.model_dump()],
    ids=str,
)
def test_in_its_rest_pose_it_stays_without_torque(start: Callable, op3: Robot, options: dict[str, object]) -> None:
    """It sank out of its crouch and tipped onto its front, whenever it was parked."""
    run = start(torque=False, **options | {"start": "rest"})
    run.tick(1000)
    assert run.tilt < op3.safety.fall_tilt - np.radians(5.0)
    assert np.abs(run.driver.truth().foot_velocity).max() < 0.01


@pytest.mark.parametrize("mass", [None, 3.5])
def test_it_stands_under_perturbations(start: Callable, mass: float | None) -> None:
    run = start(**PERTURBED.model_dump() | {"total_mass": mass})
    run.tick(500)
    assert run.tilt < 0.1
    assert run.driver.violations == 0


def test_a_hard_push_makes_it_fall(start: Callable) -> None:
    run = start(pushes=[{"at": 0.5, "impulse": [2.0, 0.0, 0.0]}])
    run.tick(60)
    assert run.tilt < 0.06
    run.tick(150)
    assert run.tilt > 0.8


def test_torque_off_it_falls_and_held_it_does_not(start: Callable) -> None:
    run = start(torque=False)
    run.tick(125)
    assert run.tilt < 0.01  # the torso is held until torque goes on
    run.driver.set_torque(True)
    run.tick(125)
    assert run.tilt < 0.06
    run.driver.set_torque(False)
    run.tick(125)
    assert run.driver.truth().base_position[2] < 0.6 * STANDING_HEIGHT


def test_damped_it_comes_down_slower_than_with_torque_off(start: Callable) -> None:
    heights = []
    for let_go in (SimDriver.damp, lambda driver: driver.set_torque(False)):
        run = start()
        run.tick(60)
        let_go(run.driver)
        run.command.position[:] = run.state.position
        run.tick(60)
        heights.append(run.driver.truth().base_position[2])
    assert heights[0] > heights[1] + 0.02
    assert heights[0] < STANDING_HEIGHT - 0.005


def test_a_slow_move_to_the_rest_pose_stays_upright(start: Callable, op3: Robot) -> None:
    run = start()
    for share in np.linspace(0, 1, 250):
        run.command.position[:] = (1 - share) * op3.stand_pose + share * op3.rest_pose
        run.tick()
    run.tick(125)
    assert run.tilt < 0.5
    assert np.abs(run.driver.truth().torque).max() < 0.3 * op3.stall_torque[0]
    assert not run.driver.truth().self_contact
    assert run.driver.violations == 0


def test_suspended_it_hangs_with_its_feet_in_the_air(start: Callable) -> None:
    run = start(suspended=True)
    run.tick(125)
    truth = run.driver.truth()
    assert truth.foot_position[:, 2].min() > 0.1
    assert not truth.foot_force.any()
    assert run.tilt < 0.02


def test_equal_options_give_equal_runs_bit_for_bit(start: Callable) -> None:
    def trace(seed: int, *, look: bool) -> bytes:
        run = start(**PERTURBED.model_dump() | {"seed": seed})
        rows = []
        for tick in range(120):
            run.command.position[:] = run.driver.robot.stand_pose + 0.05 * np.sin(0.1 * tick)
            run.tick()
            if look:
                run.driver.truth()  # reading the truth must not change the run
            rows.append(np.concatenate([run.state.position, run.state.gyro, run.state.accel]))
        return np.array(rows).tobytes()

    assert trace(3, look=False) == trace(3, look=True)
    assert trace(3, look=False) != trace(4, look=False)


def test_opening_again_starts_over(start: Callable) -> None:
    run = start()
    traces = []
    for _ in range(2):
        run.driver.open()
        run.driver.set_torque(True)
        run.tick(40)
        traces.append((run.state.position.tobytes(), run.state.accel.tobytes(), run.driver.time))
    assert traces[0] == traces[1]


def test_goals_outside_the_limits_are_counted_by_the_receiver(start: Callable, op3: Robot) -> None:
    run = start()
    run.tick(2)
    knee = op3.index("l_knee")
    run.command.position[knee] = op3.lower[knee] - 0.1
    run.driver.write(run.command)
    assert run.driver.violations >= 1
    before = run.driver.violations
    run.driver.set_torque(False)
    run.driver.write(run.command)
    assert run.driver.violations == before


def test_torque_on_pins_goals_to_the_present_position(start: Callable, op3: Robot) -> None:
    run = start(torque=False)
    run.command.position[:] = op3.rest_pose  # an old goal, far away
    run.tick(20)
    present = run.driver.truth().joint_position
    run.driver.set_torque(True)
    for _ in range(25):
        run.driver.advance(0.008)
    assert np.abs(run.driver.plant.goal - present).max() <= op3.tick_rad[0]
    assert np.abs(run.driver.truth().joint_position - present).max() < 0.06


@pytest.mark.parametrize(("delay", "extra"), [(0.004, 0.0), (0.010, 0.0), (0.004, 0.006)])
def test_commands_act_after_the_delay(start: Callable, op3: Robot, delay: float, extra: float) -> None:
    run = start(suspended=True, command_delay_s=delay, extra_latency_s=extra)
    run.driver.advance(0.1)
    assert run.driver.delay_s == delay
    pan = op3.index("head_pan")
    run.command.position[pan] += 0.2
    run.driver.write(run.command)
    run.driver.advance(delay + extra)
    assert run.driver.truth().joint_position[pan] == pytest.approx(0.0, abs=1e-6)
    run.driver.advance(0.004)
    assert run.driver.truth().joint_position[pan] > 1e-4


def test_what_is_read_is_as_old_as_the_read_delay(start: Callable, op3: Robot) -> None:
    run = start(suspended=True, read_delay_s=0.006)
    run.command.position[op3.index("head_pan")] = 0.2
    for _ in range(5):
        run.driver.write(run.command)
        run.driver.advance(0.008)
    then = run.driver.truth().joint_position
    run.driver.advance(0.006)
    run.driver.read(run.state)
    assert np.abs(run.state.position - then).max() <= op3.tick_rad[0] / 2 + 1e-9
    assert np.abs(run.driver.truth().joint_position - then).max() > 2 * op3.tick_rad[0]
    assert run.state.stamp_ns == 40_000_000


def test_positions_are_read_in_whole_ticks(start: Callable, op3: Robot) -> None:
    run = start()
    run.tick(20)
    ticks = run.state.position / op3.tick_rad
    np.testing.assert_allclose(ticks, np.rint(ticks), atol=1e-6)


def test_a_torque_bound_binds(start: Callable, op3: Robot) -> None:
    run = start(suspended=True)
    elbow = op3.index("l_el")
    run.command.position[elbow] = 0.2
    run.command.torque_bound[elbow] = 0.05
    run.tick(3)
    truth = run.driver.truth()
    assert abs(truth.torque[elbow]) <= 0.05 + 1e-9
    assert truth.saturated[elbow] > 0.5


def test_a_low_supply_makes_weak_servos(start: Callable) -> None:
    run = start(voltage=9.0, supply_resistance=0.1)
    run.tick(60)
    assert run.state.voltage[0] == pytest.approx(9.0, abs=0.2)
    assert run.driver.plant.voltage < 9.0


def test_an_overheated_servo_shuts_down_and_stays_off(
    start: Callable, op3: Robot, caplog: pytest.LogCaptureFixture
) -> None:
    run = start(suspended=True)
    elbow = op3.index("l_el")
    run.driver.plant.temperature[elbow] = 90.0
    run.tick(2)
    assert run.state.hardware_error[elbow] == OVERHEATED
    assert np.count_nonzero(run.state.hardware_error) == 1
    run.driver.set_torque(True)
    assert not run.driver.plant.enabled[elbow] and run.driver.plant.enabled.sum() == op3.n - 1
    assert caplog.text.count("l_el") == 1


def test_time_passes_in_whole_steps_and_none_is_lost(start: Callable) -> None:
    run = start(suspended=True)
    for _ in range(120):
        run.driver.advance(1 / 120)
    assert run.driver.time == pytest.approx(1.0, abs=0.002)


@pytest.mark.parametrize("timestep", [0.001, 0.004])
def test_other_timesteps_stand_as_well(start: Callable, timestep: float) -> None:
    run = start(timestep=timestep)
    run.tick(125)
    assert run.tilt < 0.06
    assert run.driver.truth().base_position[2] == pytest.approx(STANDING_HEIGHT, abs=0.005)


def test_joints_may_come_in_any_order(start: Callable, op3: Robot, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("turned") / "op3"
    shutil.copytree(ROBOTS / "op3", folder)
    content = yaml.safe_load((folder / "op3.yaml").read_text())
    content["joints"].reverse()
    (folder / "op3.yaml").write_text(yaml.safe_dump(content))
    turned = start(robot=load_robot(folder), noise_scale=0.0)
    straight = start(noise_scale=0.0)
    for run in (turned, straight):
        run.tick(100)
    np.testing.assert_allclose(turned.state.position[::-1], straight.state.position, atol=2 * op3.tick_rad[0])


def test_capabilities_are_known_before_open(op3: Robot) -> None:
    capabilities = SimDriver(op3).capabilities
    assert capabilities.imu and capabilities.effort and capabilities.torque_bound
    assert capabilities.lockstep and capabilities.truth
    assert not SimDriver(op3, options=SimOptions(imu=False)).capabilities.imu


def test_close_leaves_torque_off_and_may_be_called_twice(op3: Robot) -> None:
    driver = SimDriver(op3)
    with driver:
        driver.set_torque(True)
    assert not driver.plant.enabled.any()
    driver.close()
