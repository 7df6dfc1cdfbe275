"""`AllowedClips`: the clips that targets may name in a run whose human is sampled from a model."""

from __future__ import annotations

from collections.abc import Mapping

from flexmotion.configs.errors import ConfigError
from flexmotion.human.body import Body
from flexmotion.human.motion import Motion
from flexmotion.streamer.motion.intents import Clip
from flexmotion.streamer.motion.sequence import placed, poses_only

_NAMED = 20
"""Names in a message."""


class AllowedClips:
    """Clips by name, at the model's frame rate, and the one that is followed.

    Args:
        clips: by name.
        fps: of the model.
        body: of the model's human.

    Attributes:
        clips: by name.

    Raises:
        ConfigError: a clip has another frame rate, or fewer than two frames.
    """

    def __init__(self, clips: Mapping[str, Motion], fps: float, body: Body) -> None:
        wrong = [name for name, clip in clips.items() if clip.fps != fps or len(clip) < 2]
        if wrong:
            raise ConfigError(f"clip {wrong[0]!r}: expected two frames or more at {fps:g} frames a second")
        self.clips, self._body = dict(clips), body
        self._first, self._placed = 0, None

    _placed: Motion | None

    def require(self, clip: Clip) -> None:
        """Raise `ConfigError` if there is no such clip; names those that there are."""
        if clip.name not in self.clips:
            known = ", ".join(sorted(self.clips)[:_NAMED])
            may = f"this run takes: {known}" if known else "this run takes none; start it with --clips FILE"
            raise ConfigError(f"clip: {clip.name!r} is unknown; {may}")

    def seconds(self, clip: Clip) -> float:
        """Length of a clip [s]."""
        return self.clips[clip.name].duration

    def begin(self, clip: Clip, frame: int, at: Motion) -> None:
        """Follow a clip from a frame on, at the place and heading of the human in the frame before it (`at`)."""
        motion = poses_only(self.clips[clip.name])
        scale = self._body.standing_height / motion.body.standing_height
        self._first, self._placed = frame, placed(motion, at, scale)

    def window(self, frame: int, frames: int) -> Motion | None:
        """At most so many frames of the clip from a frame on; None after its end."""
        if self._placed is None or not 0 <= frame - self._first < len(self._placed):
            return None
        return self._placed[frame - self._first : frame - self._first + frames]
