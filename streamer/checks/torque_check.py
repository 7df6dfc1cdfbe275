"""Check of the plans of a motion, as they would be sent, against what every servo can give: torque and heat."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from flexmotion.configs.envelope import Envelope
from flexmotion.configs.heat import endurance
from flexmotion.configs.robot import Robot
from flexmotion.retarget.servo_lag import allowed_lag, servo_lag
from flexmotion.streamer.planning.offline import Trajectory
from flexmotion.streamer.report.figure import Figure, Maybe

Float = NDArray[np.float64]

HEAT_S = 600.0
"""Time for which a motion is repeated to judge its heat [s]: ten minutes."""


class Stretch(BaseModel):
    """Ticks in a row in which a joint needs more than its servo has.

    Attributes:
        from_s, for_s: begin and length [s].
        peak_torque_nm, limit_nm: torque and limit in the tick that is furthest outside [N·m].
        peak_load: its share of the envelope; 1 is the border.
        lag_rad: largest distance of the joint behind its plan in the stretch and the tenth of a second after [rad].
    """

    model_config = ConfigDict(frozen=True)

    from_s: Figure
    for_s: Figure
    peak_torque_nm: Figure
    limit_nm: Figure
    peak_load: Figure
    lag_rad: Figure


class JointTorque(BaseModel):
    """One joint.

    Attributes:
        ok: whether its lag and its heat are within what is allowed.
        peak_load: largest share of the envelope; `peak_at_s`, `peak_torque_nm`, `peak_limit_nm`, `peak_excess_nm`:
            time, torque, limit and excess of that tick (negative: margin).
        over_s, over_share: time outside the envelope, and its share of the motion.
        stretches: number of stretches outside; `worst`: the one with the largest lag, None without any.
        lag_rad, lag_at_s: largest distance behind the plan for lack of torque, and when.
        rms_torque_nm, rms_share_of_stall: of the whole motion.
        after_10_min_c, settles_at_c: temperature of the windings if the motion goes on for ten minutes, without end.
        lasts_s: time until the servo parks the robot (`safety.thermal_margin` before its own shutdown); None: never.
        duty: share of the time for which the motion may be repeated without end.
    """

    model_config = ConfigDict(frozen=True)

    ok: bool
    peak_load: Figure
    peak_at_s: Figure
    peak_torque_nm: Figure
    peak_limit_nm: Figure
    peak_excess_nm: Figure
    over_s: Figure
    over_share: Figure
    stretches: int
    worst: Stretch | None
    lag_rad: Figure
    lag_at_s: Figure
    rms_torque_nm: Figure
    rms_share_of_stall: Figure
    after_10_min_c: Figure
    settles_at_c: Figure
    lasts_s: Maybe
    duty: Figure


class TorqueCheck(BaseModel):
    """Result of `flexmotion check torque`.

    Attributes:
        supply_v: supply that it is judged at [V]; None: each servo's nominal one.
        lag_allowed_rad: see `allowed_lag`.
        refused: words that were refused, so that nothing was planned for them; with one the result is not ok.
        failed: joints that are not ok, the worst first.
        worst: the joint with the largest lag, or closest to its envelope.
    """

    model_config = ConfigDict(frozen=True)

    schema_: Literal["flexmotion.torque/1"] = Field(default="flexmotion.torque/1", alias="schema")
    ok: bool
    robot: str
    source: str
    duration_s: Figure
    supply_v: Maybe
    lag_allowed_rad: Figure
    refused: tuple[str, ...] = ()
    failed: tuple[str, ...]
    worst: str
    joints: dict[str, JointTorque]

    def json_text(self) -> str:
        """The result as JSON, keys in the order of the schema."""
        return self.model_dump_json(by_alias=True, indent=2)


def check_trajectory(
    trajectory: Trajectory, robot: Robot, source: str, supply: float | None = None, refused: tuple[str, ...] = ()
) -> TorqueCheck:
    """Compare the torque of every joint and tick with its servo's envelope, and its RMS with the servo's heat.

    The torques are those that the plans carry to the loop: inverse dynamics under the planned ground forces. A joint
    fails where lack of torque lets it lag behind by more than `allowed_lag`, or where its servo would park the robot
    within ten minutes of this motion (within the motion itself, if that is longer).

    Args:
        supply: voltage at the servos [V]; None: nominal.
        refused: words of the source that were refused.
    """
    envelope = Envelope.of(robot).at(supply)
    torque, speed, rate = trajectory.torque, trajectory.qd, trajectory.rate_hz
    limit, load = envelope.limit(torque, speed), envelope.load(torque, speed)
    lag = np.abs(servo_lag(robot, envelope, torque, speed))
    rms = np.sqrt(np.mean(torque**2, axis=0))
    allowed, heated_s = allowed_lag(robot), max(HEAT_S, trajectory.duration)
    joints: dict[str, JointTorque] = {}
    for joint, name in enumerate(robot.joint_names):
        peak, latest = int(np.argmax(load[:, joint])), int(np.argmax(lag[:, joint]))
        heat = endurance(robot, joint, float(rms[joint]), robot.safety.thermal_margin)
        stretches = _stretches(torque[:, joint], limit[:, joint], load[:, joint], lag[:, joint], rate)
        over = load[:, joint] > 1.0
        joints[name] = JointTorque(
            ok=lag[latest, joint] <= allowed and (heat.seconds is None or heat.seconds >= heated_s),
            peak_load=load[peak, joint],
            peak_at_s=peak / rate,
            peak_torque_nm=abs(torque[peak, joint]),
            peak_limit_nm=limit[peak, joint],
            peak_excess_nm=abs(torque[peak, joint]) - limit[peak, joint],
            over_s=np.count_nonzero(over) / rate,
            over_share=float(np.mean(over)),
            stretches=len(stretches),
            worst=max(stretches, key=lambda stretch: stretch.lag_rad, default=None),
            lag_rad=lag[latest, joint],
            lag_at_s=latest / rate,
            rms_torque_nm=rms[joint],
            rms_share_of_stall=rms[joint] / robot.stall_torque[joint],
            after_10_min_c=heat.after(HEAT_S),
            settles_at_c=heat.temperature,
            lasts_s=heat.seconds,
            duty=heat.duty,
        )
    order = sorted(joints, key=lambda name: (joints[name].ok, -joints[name].lag_rad, -joints[name].peak_load))
    return TorqueCheck(
        ok=not refused and all(joint.ok for joint in joints.values()),
        robot=robot.name,
        source=source,
        duration_s=trajectory.duration,
        supply_v=supply,
        lag_allowed_rad=allowed,
        refused=refused,
        failed=tuple(name for name in order if not joints[name].ok),
        worst=order[0],
        joints=joints,
    )


def _stretches(torque: Float, limit: Float, load: Float, lag: Float, rate_hz: float) -> list[Stretch]:
    """The stretches of one joint outside its envelope, in their order."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], load > 1.0, [False]]).astype(np.int8)))
    found = []
    for begin, end in edges.reshape(-1, 2):
        peak = int(begin + np.argmax(load[begin:end]))
        found.append(
            Stretch(
                from_s=begin / rate_hz,
                for_s=(end - begin) / rate_hz,
                peak_torque_nm=abs(torque[peak]),
                limit_nm=limit[peak],
                peak_load=load[peak],
                lag_rad=lag[begin : end + int(0.1 * rate_hz)].max(),
            )
        )
    return found
