"""`MirrorSource`: the person in front of the robot, as far as known, and then as foreseen."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.configs.errors import ConfigError
from flexmotion.human.body import Body
from flexmotion.human.concatenate import concatenate
from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Sampler
from flexmotion.spatial.heading import heading
from flexmotion.spatial.quaternions import continuous_quaternions
from flexmotion.streamer.motion.intents import Text, word_of
from flexmotion.streamer.motion.person_channel import FPS, PersonChannel, PersonPose, pose_of
from flexmotion.streamer.motion.prediction import Foreseen, HeldSpeed, ModelPrediction, Predictor
from flexmotion.streamer.motion.targets import Target
from flexmotion.streamer.motion.undo import Undo

Float = NDArray[np.float64]

SILENT_S = 0.3
"""A person of whom nothing is seen for this long is gone: the robot comes to a stand [s]."""
LEAST_POSES = 6
"""Poses of a stream before the robot follows it: fewer say no speed."""
WORDS = ("mirror", "mirror me", "mirror the person")
"""Targets that are followed: they release the stand after a stop."""
GOES_ON = 'mirroring goes on with the text "mirror": flexmotion send mirror'
"""What is told to who stops a robot that mirrors, or lets it go on after a stop."""
_KEPT_S = 2.0
_RATE_POSES = 12
"""Poses that show how often frames come."""


class MirrorSource:
    """A source whose time is that of the loop: a frame shows the person at the moment at which it is played.

    The person is placed where the human of the robot stands when it begins to be followed, with its heading, and moves
    from there. It has the measured body of the person.

    Args:
        channel: of the poses.
        sampler: of a model, which foresees what the person does; None: the speed is held and dies away.
        name: for the report.

    Attributes:
        fps: of poses and frames.
        wanted: a person is there who is not followed yet; `begin` follows them.
        resting: nobody is followed: the robot is to come to its balanced stop, and to stand.
        newest_s: arrival of the newest frame that plans follow from now on, on the clock of the poses [s].
    """

    def __init__(self, channel: PersonChannel, sampler: Sampler | None = None, name: str = "mirror") -> None:
        if sampler is not None and abs(sampler.fps - FPS) > 1e-6:
            raise ConfigError(f"mirror: model {sampler.name} has {sampler.fps:g} frames/s, expected {FPS:g}")
        self.channel, self.sampler, self.name, self.fps = channel, sampler, name, FPS
        self.predictor: Predictor = HeldSpeed(FPS) if sampler is None else ModelPrediction(sampler)
        self.wanted, self.resting = False, True
        self.newest_s = -np.inf
        self._reader = channel.reader(new_only=True)
        self._poses: deque[PersonPose] = deque(maxlen=round(_KEPT_S * FPS))
        self._place: Callable[[Motion], Motion] = lambda pose: pose
        self._followed = 0  # stream that is followed; 0: none
        self._standing: Motion | None = None  # the last human that was played
        self._zero_s = 0.0  # time of frame 0
        self._foreseen: tuple[float, Foreseen] | None = None

    @property
    def body(self) -> Body:
        """Of the person who is seen; a mean one before."""
        return self._poses[-1].motion.body if self._poses else Body()

    @property
    def between_s(self) -> float:
        """Median time between the last frames that brought poses [s]; NaN before there are some."""
        arrivals = np.unique([pose.arrived_s for pose in list(self._poses)[-_RATE_POSES:]])
        return float(np.median(np.diff(arrivals))) if len(arrivals) >= LEAST_POSES else np.nan

    def update(self, now_s: float) -> None:
        """Take the poses that have come. `now_s`: present time, on their clock [s]."""
        for row in self._reader.read():
            pose = pose_of(row)
            if self._poses and self._poses[-1].stream != pose.stream:
                self._poses.clear()
            self._poses.append(pose)
        newest = self._poses[-1] if self._poses else None
        seen = newest is not None and now_s - newest.arrived_s <= SILENT_S
        if newest is not None and seen and newest.stream == self._followed:
            self.wanted, self.newest_s = False, newest.arrived_s
            return
        self._followed, self.resting = 0, True
        self.wanted = seen and len(self._poses) >= LEAST_POSES

    def align(self, zero_s: float) -> None:
        """Say when frame 0 is played, on the clock of the poses [s]."""
        self._zero_s = zero_s

    def begin(self, frame: int, played: Motion | None, yaw: float | None = None) -> None:
        """Follow the person from `frame` on; see `LiveSource.turn_to`."""
        newest = self._poses[-1]
        at = played[len(played) - 1 :] if played is not None else self._standing
        self._place = _placing(newest.motion, at, yaw)
        self._followed, self._foreseen = newest.stream, None
        self.wanted, self.resting, self.newest_s = False, False, newest.arrived_s

    def turn_to(self, target: Target, frame: int, played: Motion | None, yaw: float | None = None) -> None:
        """See `LiveSource.turn_to`. Raises `ConfigError` unless the target asks to mirror, and a person is seen."""
        if not isinstance(target.intent, Text) or target.intent.text.strip().lower() not in WORDS:
            raise ConfigError(
                f"target: {word_of(target.intent)} cannot be followed: this run mirrors a person; "
                f'expected the text "{WORDS[0]}", which goes on after a stop, or "stop", a stand'
            )
        if self.resting and not self.wanted:
            raise ConfigError("target: nobody is seen who could be mirrored")
        self.begin(frame, played, yaw)

    def kept(self) -> Undo:
        """See `LiveSource.kept`; poses that have come since stay."""
        return Undo(self)

    def window(self, first_frame: int, frames: int) -> Motion | None:
        """See `Source.window`; None where nobody is followed."""
        if not self._followed or not self._poses:
            return None
        found = self._seen_and_foreseen(frames).at(self._zero_s + first_frame / self.fps, frames)
        self._standing = found[:1]
        return found

    def _seen_and_foreseen(self, frames: int) -> Foreseen:
        newest_s = self._poses[-1].time_s
        if self._foreseen is None or self._foreseen[0] != newest_s:
            seen = self._place(concatenate([pose.motion for pose in self._poses]))
            history = seen[max(len(seen) - self.predictor.remembers, 0) :]
            # A plan joins up to half a second ahead of the newest pose.
            ahead = self.predictor(history, frames + round(0.5 * self.fps))
            motion = concatenate([seen, ahead])
            motion = replace(motion, root_quaternion=continuous_quaternions(motion.root_quaternion))
            self._foreseen = newest_s, Foreseen(motion, newest_s - (len(seen) - 1) / self.fps)
        return self._foreseen[1]


def _placing(pose: Motion, at: Motion | None, yaw: float | None) -> Callable[[Motion], Motion]:
    """Moves a person so that the last of its poses is where `at` is, with its heading, or with `yaw`."""
    own = heading(pose.root_quaternion[0])
    to = yaw if yaw is not None else 0.0 if at is None else float(heading(at.root_quaternion[0]))
    turn = Rotation.from_euler("z", to - own)
    place = np.zeros(3) if at is None else at.root_position[0] * [1.0, 1.0, 0.0]
    shift = place - turn.apply(pose.root_position[0] * [1.0, 1.0, 0.0])

    def moved(motion: Motion) -> Motion:
        turned = turn * Rotation.from_quat(motion.root_quaternion, scalar_first=True)
        quaternions = continuous_quaternions(turned.as_quat(scalar_first=True))
        return replace(motion, root_position=turn.apply(motion.root_position) + shift, root_quaternion=quaternions)

    return moved
