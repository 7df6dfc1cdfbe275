"""`LivePerson`: frames of a person as they come, to poses at a fixed rate; causal.

The body is measured from the first second, and anew once a part is seen that was not seen then. After that a pose
depends on the frames up to it alone.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import floor

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import FlexMotionError, MotionFormatError
from flexmotion.human.floor import clip_floor
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.importers.body_size import with_mass
from flexmotion.importers.fit import Measures, measure, posed
from flexmotion.importers.frame import Frame, Skeleton, capture_of
from flexmotion.importers.frame_check import FASTEST, FrameCheck, leg_length
from flexmotion.importers.hip_path import HipPath
from flexmotion.importers.landmarks import Landmarks, all_landmarks
from flexmotion.importers.mapping import OPTIONAL_POINTS, SkeletonMapping, find_mapping, markers
from flexmotion.importers.one_euro import OneEuro
from flexmotion.importers.units import LEG, METRES, TO_Z_UP

Float = NDArray[np.float64]

MEASURE_S, LEAST_FRAMES = 1.0, 15
"""The body is measured from frames of this length [s], and at least so many."""
GAP_S = 0.3
"""After a longer gap between frames the poses begin anew [s]."""
RENEW_S = 0.7
"""Another body or skeleton that is seen for this long is measured in the place of the one before [s]."""
CLOSEST_S = 1.0 / 250.0
"""Frames closer than this add nothing, and are left out [s]."""
WINDOW = 9
"""Frames from which a pose is computed: a straight knee faces as it did when it was last bent."""
STILL_HZ, HZ_PER_SPEED = 4.0, 10.0
"""Cut-off of positions at rest [Hz], and what speed adds to it [Hz per m/s] (docs/decisions.md)."""

REASONS = {
    "late": "it came after a newer one",
    "too fast": f"it is less than {1e3 * CLOSEST_S:g} ms after the one before",
    "a leg is not seen": "hips, knees, ankles and toes of both sides are needed",
    "no human": f"legs are {LEG.low:g} to {LEG.high:g} m long: are the units right?",
    "another body": f"a person whose legs are longer or shorter is measured once seen for {RENEW_S:g} s",
    "another skeleton": f"it is read once seen for {RENEW_S:g} s",
    "not upright": "the shoulders are not above the feet: is `up` right, is the camera the right way up?",
    "sides exchanged": "left and right joints were exchanged",
    "a jump": f"a joint went faster than {FASTEST:g} m/s",
}
"""Why frames are not used, by which they are counted, and what would be right."""
_OTHER = ("another body", "another skeleton")
"""Reasons that, where they last, mean another person. After jumps and exchanged sides the poses begin anew with the gap
that they leave."""


@dataclass(frozen=True)
class LivePose:
    """One pose.

    Attributes:
        time_s: of the pose, a multiple of the rate's period, on the clock of the frames [s].
        stream: number of the unbroken stream that it belongs to, from 1.
        motion: one frame of the measured body, on the floor z = 0.
    """

    time_s: float
    stream: int
    motion: Motion


class LivePerson:
    """Turns frames into poses.

    Args:
        fps: of the poses [1/s].
        mapping: of the skeleton; see `mapping.find_mapping`.

    Attributes:
        refused: frames that were not used, by reason.
        trouble: why the newest skeleton cannot be used; None: it can.
    """

    def __init__(self, fps: float = 30.0, mapping: str | None = None) -> None:
        self.fps, self.refused = fps, dict.fromkeys(REASONS, 0)
        self.trouble: str | None = None
        self._wanted, self._stream = mapping, 0
        self._measures: Measures | None = None
        self._unseen: list[str] = []  # points that the person was measured without
        self._known: Float | None = None  # positions in the last frame that was used
        self._others_since: float | None = None  # since when another body or skeleton has been seen
        self._begin(None)

    @property
    def measured(self) -> bool:
        """Whether the body is known."""
        return self._measures is not None

    @property
    def unseen(self) -> list[str]:
        """Joints of the skeleton that the measured person is fitted without: they have not been seen yet."""
        return [] if self._mapping is None else [self._mapping.joints[point] for point in self._unseen]

    def take(self, frame: Frame, time_s: float) -> list[LivePose]:
        """The poses that a frame completes, oldest first.

        Args:
            time_s: of the frame, on the clock of the poses [s].
        """
        if self._skeleton is None:
            self._begin(frame.skeleton)
        last = self._last
        reason: str | None = None
        if last is not None and time_s < last[0] + CLOSEST_S:
            reason = "late" if time_s <= last[0] else "too fast"
        elif frame.skeleton != self._skeleton:
            reason = "another skeleton"
        elif self._mapping is None:
            reason = "no human"
        if last is not None and time_s - last[0] > GAP_S:
            self._pause()
        if reason is not None:
            return self._refuse(frame, time_s, reason)
        frame = self._seen(frame)
        points = self._points(frame)
        reason = self._check.fault(time_s, points)
        if reason is not None:
            return self._refuse(frame, time_s, reason)
        self._others_since = None
        if any(np.isfinite(points[point]).all() for point in self._unseen):  # for the first time
            self._measures, self._unseen = None, []
            self._pause()
        self._check.take(time_s, points)
        self._known = frame.positions
        return self._taken(frame, time_s)

    def _begin(self, skeleton: Skeleton | None) -> None:
        """Begin with another skeleton or person."""
        self._skeleton, self._mapping = skeleton, None
        self._columns: dict[str, NDArray[np.intp]] = {}
        self._measures, self._unseen = None, []
        self._floor = 0.0
        self._check = FrameCheck()
        self._others_since = None
        self._known = None
        self._pause()
        if skeleton is None:
            return
        try:
            self._mapping = _joints_of(skeleton, self._wanted)
            self.trouble = None
        except FlexMotionError as error:
            self.trouble = str(error)
            return
        self._columns = {
            point: np.array([skeleton.names.index(name) for name in markers(joint)], dtype=np.intp)
            for point, joint in self._mapping.joints.items()
        }

    def _pause(self) -> None:
        """The stream has a gap: poses and filters begin anew, the measured body stays."""
        self._last: tuple[float, Frame] | None = None
        self._recent: deque[Frame] = deque(maxlen=WINDOW)
        self._first: list[Frame] = []
        self._filter = OneEuro(STILL_HZ, HZ_PER_SPEED, self.fps)
        self._path = HipPath()
        self._check.forget()
        self._broken = True

    def _refuse(self, frame: Frame, time_s: float, reason: str) -> list[LivePose]:
        self.refused[reason] += 1
        if reason == "not upright":
            # The body is measured from an unbroken second: single frames of a person who lies may look upright.
            self._first = []
        if reason not in _OTHER:
            return []
        if self._others_since is None or time_s < self._others_since:
            self._others_since = time_s
        if time_s - self._others_since > RENEW_S:
            self._begin(frame.skeleton)
        return []

    def _points(self, frame: Frame) -> Mapping[str, Float]:
        """Points of the mapping, z up [m]."""
        scale, turn = METRES[frame.skeleton.units], TO_Z_UP[frame.skeleton.up]
        picked = frame.positions[np.concatenate(list(self._columns.values()))]
        counts = np.array([len(at) for at in self._columns.values()])
        means = np.add.reduceat(picked, np.cumsum(counts) - counts, axis=0) / counts[:, None]
        return dict(zip(self._columns, means @ (scale * turn).T, strict=True))

    def _seen(self, frame: Frame) -> Frame:
        """The frame with points of trunk and arms that are not seen where they were, relative to the hips.

        Where they were before a gap counts too: a person who comes back with an arm out of the picture is followed.
        """
        lost = [at for point, at in self._columns.items() if point in OPTIONAL_POINTS]
        columns = np.concatenate(lost) if lost else np.zeros(0, np.intp)
        hidden = columns[~np.isfinite(frame.positions[columns]).all(axis=1)]
        if not len(hidden) or self._known is None:
            return frame
        hips = np.concatenate([self._columns["hip_l"], self._columns["hip_r"]])
        before, positions = self._known, frame.positions.copy()
        positions[hidden] = before[hidden] - before[hips].mean(axis=0) + positions[hips].mean(axis=0)
        return replace(frame, positions=positions)

    def _taken(self, frame: Frame, time_s: float) -> list[LivePose]:
        last, self._last = self._last, (time_s, frame)
        if last is None:
            return []
        poses = []
        for number in range(floor(last[0] * self.fps) + 1, floor(time_s * self.fps) + 1):
            at_s = number / self.fps
            share = (at_s - last[0]) / (time_s - last[0])
            pose = self._pose(last[1].towards(frame, min(max(share, 0.0), 1.0)))
            if pose is not None:
                self._stream += self._broken
                self._broken = False
                poses.append(LivePose(at_s, self._stream, pose))
        return poses

    def _pose(self, frame: Frame) -> Motion | None:
        if frame.rotations is None:  # trackers that give rotations filter them
            frame = replace(frame, positions=self._filter(frame.positions))
        if self._measures is None:
            self._first.append(frame)
            if len(self._first) >= max(MEASURE_S * self.fps, LEAST_FRAMES):
                self._measure()
            return None
        self._recent.append(frame)
        motion = self._posed(list(self._recent), self._measures)
        pose = motion[len(motion) - 1 :]
        if frame.skeleton.hip_centred:
            return self._path(pose)
        return replace(pose, root_position=pose.root_position - [0.0, 0.0, self._floor])

    def _posed(self, frames: list[Frame], measures: Measures) -> Motion:
        return posed(self._landmarks(frames), measures)

    def _landmarks(self, frames: list[Frame]) -> Landmarks:
        """Points of frames, as those of a file that lacks what was not seen yet. Raises `MotionFormatError`."""
        assert self._mapping is not None
        joints = {point: joint for point, joint in self._mapping.joints.items() if point not in self._unseen}
        mapping, skeleton = self._mapping.model_copy(update={"joints": joints}), frames[-1].skeleton
        return all_landmarks(capture_of(frames, self.fps), mapping, units=skeleton.units, up=skeleton.up)

    def _measure(self) -> None:
        frames, self._first = self._first, []
        known = np.isfinite(np.stack([frame.positions for frame in frames]))
        seen = {point: known[:, at].all(axis=(1, 2)) for point, at in self._columns.items()}
        if any(one.any() and not one.all() for one in seen.values()):
            return  # a part came into the picture meanwhile
        self._unseen = [point for point, one in seen.items() if not one.all()]
        try:
            found = self._landmarks(frames)
        except MotionFormatError:
            self.refused["no human"] += len(frames)
            return
        measures = measure(found)
        body, _ = with_mass(measures.body, None, None)
        self._measures = replace(measures, body=body)
        self._floor = clip_floor(forward(posed(found, self._measures)), self.fps)
        legs = [leg_length(self._points(frame)) for frame in frames]
        self._check.leg = float(np.median(legs))


def _joints_of(skeleton: Skeleton, wanted: str | None) -> SkeletonMapping:
    """The mapping of a skeleton's joints. Raises `FlexMotionError` where there is none."""
    mapping = find_mapping(skeleton.names, skeleton.protocol, wanted)
    if mapping.markers:
        raise MotionFormatError(
            f"{skeleton.protocol}: {mapping.name!r} maps surface markers, expected joint centres of a skeleton"
        )
    return mapping
