"""Stream settings: how plans are made, joined and timed, and the budgets of `check latency`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, model_validator

from flexmotion.configs.gamepad import Gamepad
from flexmotion.configs.schema import Strict, load

FOLDER = Path(__file__).parent / "stream"


class Budgets(Strict):
    """Upper bounds on timing.

    Attributes:
        target_to_command_ms: time from the arrival of a target to the first command computed from it, 95th percentile.
        target_to_command_p50_ms, target_to_command_p99_ms: likewise, median and 99th percentile while the machine kept
            its pace.
        loop_work_p99_ms: work of one loop tick, 99th percentile.
        wake_lateness_p99_ms: lateness of the loop's wake-up, 99th percentile.
        missed_deadlines: ticks of a run that may overrun.
        underruns: times in a run that the loop may reach the end of its plan.
    """

    target_to_command_ms: float = Field(default=60.0, gt=0)
    target_to_command_p50_ms: float = Field(default=35.0, gt=0)
    target_to_command_p99_ms: float = Field(default=50.0, gt=0)
    loop_work_p99_ms: float = Field(default=2.0, gt=0)
    wake_lateness_p99_ms: float = Field(default=1.0, gt=0)
    missed_deadlines: int = Field(default=0, ge=0)
    underruns: int = Field(default=0, ge=0)


class Gateway(Strict):
    """How targets of other programs are admitted (`flexmotion run --web`). Times in seconds.

    The priority of a sender is set here, not by the sender.

    Attributes:
        port, stop_port: of the gateway, and of the process that takes stops alone.
        foxglove_port: of the live view for Foxglove (`--foxglove`).
        priorities: by the name of a source; a source with a higher priority takes the lease over without asking.
        other_priority: of all other sources.
        lease_s: an operator who sends nothing for this long holds the lease no longer.
        velocity_holds_s: a velocity without a time to live of its own holds this long.
        part_holds_s: a hand, a look or a joint without a time to live of its own is held this long.
        take_up_s: a target that no plan follows within this time is dropped.
        coalesce_s: targets that come faster than one in this time are reduced to the newest; two may come at once.
        most_bytes: longest message.
        most_connections: connections at a time; further ones are refused.
        most_unread: a connection that leaves so many answers unread is closed.
        name: of the robot in keys of zenoh and topics of ROS 2; None: that of the robot file.
        zenoh_port, zenoh_stop_port: of the gateway and of the stop process for zenoh.
        zenoh_open_router: whether a zenoh router may be used without a token: whoever reaches it steers the robot.
        ros2_port: of the zenoh router of ROS 2 on this machine.
        ros2_types: messages that are taken over ROS 2, which has no token.
        ros2_rate_hz: joint states and IMU that are published a second.
        gamepad: what its sticks and buttons do.
    """

    port: int = Field(default=8790, ge=1, le=65535)
    stop_port: int = Field(default=8791, ge=1, le=65535)
    foxglove_port: int = Field(default=8765, ge=1, le=65535)
    priorities: dict[str, int] = {}
    other_priority: int = 0
    lease_s: float = Field(default=10.0, gt=0)
    velocity_holds_s: float = Field(default=0.5, gt=0)
    part_holds_s: float = Field(default=10.0, gt=0)
    take_up_s: float = Field(default=5.0, gt=0)
    coalesce_s: float = Field(default=0.005, ge=0, le=1)
    most_bytes: int = Field(default=4096, ge=512, le=65536)
    most_connections: int = Field(default=32, ge=1)
    most_unread: int = Field(default=1000, ge=10)
    name: str | None = Field(default=None, pattern=r"^[a-z][a-z0-9_]{0,63}$")
    zenoh_port: int = Field(default=8792, ge=1, le=65535)
    zenoh_stop_port: int = Field(default=8793, ge=1, le=65535)
    zenoh_open_router: bool = False
    ros2_port: int = Field(default=7447, ge=1, le=65535)
    ros2_types: tuple[str, ...] = ("text", "velocity", "stop", "estop")
    ros2_rate_hz: float = Field(default=50.0, ge=1, le=250)
    gamepad: Gamepad = Gamepad()

    @model_validator(mode="after")
    def _apart(self) -> Gateway:
        names = ("port", "stop_port", "zenoh_port", "zenoh_stop_port", "ros2_port")
        for number, name in enumerate(names):
            for other in names[:number]:
                if getattr(self, name) == getattr(self, other):
                    raise ValueError(f"{other} and {name} are both {getattr(self, name)}, expected different ports")
        return self

    def priority(self, source: str) -> int:
        """Priority of a source: by its name, else by the first word of it, as of "page 3f"."""
        return self.priorities.get(source, self.priorities.get(source.partition(" ")[0], self.other_priority))


class LogParts(Strict):
    """When a log goes on in a new file, and how much of it is kept (`docs/log.md`).

    Attributes:
        part_mb: size of a file at which the next one is begun [MB].
        part_s: time that a file holds at most [s].
        keep_mb: size of all files of a log; beyond it the oldest ones but the first are removed [MB].
    """

    part_mb: float = Field(default=250.0, gt=0)
    part_s: float = Field(default=1800.0, gt=0)
    keep_mb: float = Field(default=10_000.0, gt=0)

    @model_validator(mode="after")
    def _fits(self) -> LogParts:
        if self.keep_mb < 3 * self.part_mb:
            raise ValueError(f"keep_mb {self.keep_mb} must be at least three parts of part_mb {self.part_mb}")
        return self


class StreamSettings(Strict):
    """How the live system streams. Times in seconds.

    Attributes:
        horizon_s: length of a plan.
        first_s: length of the first plan for a new target: a short plan is made sooner, the whole one right after it.
        replan_s: time between plans without a new target.
        commit_s: first part of a running plan that a periodic replan must not change; a new target or a stop may.
        min_unplayed_s: least part of a plan that must be left to play.
        change_s: shortest time between two changes of the target that is followed, a stop apart; the newest one counts.
        lead_in_s: time from the first plan to the source's first frame, in which the robot moves to its pose.
        dcm_absorb_s: time over which a new plan absorbs the jump of the divergent component of motion.
        effort_limit: greatest share of the servos' envelope that a plan may need, by inverse dynamics; a motion beyond
            it is slowed, then made smaller; refused where a joint would fall behind too far all the same. 1: the
            envelope itself; null: plans are not judged.
        blend_frames: frames of human motion over which a new plan is blended in.
        mirror_blend_frames: likewise, of a person who is mirrored: plans come more often, and each knows more.
        wake_latency_us: longest wake-up time that processors may have on the real clock [µs], if the system permits the
            setting; 0: they do not sleep; null: no limit, which draws less power.
        budgets: timing bounds.
        gateway: how targets of other programs are admitted.
        log: when a log goes on in a new file.
    """

    horizon_s: float = Field(default=1.0, gt=0)
    first_s: float = Field(default=0.4, gt=0)
    replan_s: float = Field(default=0.25, gt=0)
    commit_s: float = Field(default=0.04, ge=0)
    min_unplayed_s: float = Field(default=0.6, ge=0)
    change_s: float = Field(default=0.2, ge=0)
    lead_in_s: float = Field(default=0.6, ge=0)
    dcm_absorb_s: float = Field(default=0.15, gt=0)
    effort_limit: float | None = Field(default=None, gt=0)
    blend_frames: int = Field(default=8, ge=0)
    mirror_blend_frames: int = Field(default=1, ge=0)
    wake_latency_us: int | None = Field(default=0, ge=0, le=1_000_000)
    budgets: Budgets = Budgets()
    gateway: Gateway = Gateway()
    log: LogParts = LogParts()

    @model_validator(mode="after")
    def _fits(self) -> StreamSettings:
        if self.replan_s + self.min_unplayed_s > self.horizon_s:
            raise ValueError(
                f"replan_s {self.replan_s} + min_unplayed_s {self.min_unplayed_s} must not exceed "
                f"horizon_s {self.horizon_s}"
            )
        if not self.commit_s < self.first_s <= self.horizon_s:
            raise ValueError(
                f"first_s {self.first_s} must be longer than commit_s {self.commit_s} and not exceed "
                f"horizon_s {self.horizon_s}"
            )
        if self.commit_s > self.replan_s:
            raise ValueError(f"commit_s {self.commit_s} must not exceed replan_s {self.replan_s}")
        return self


def load_stream(file: str | Path | None = None) -> StreamSettings:
    """Stream settings from a YAML file; default: the shipped ones. Raises `ConfigError`."""
    return load(StreamSettings, FOLDER / "default.yaml" if file is None else Path(file))
