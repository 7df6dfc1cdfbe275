"""`ClipLibrary`: a source that follows targets which name its clips."""

from __future__ import annotations

from collections.abc import Mapping

from flexmotion.configs.errors import ConfigError
from flexmotion.human.motion import Motion
from flexmotion.streamer.motion.intents import Clip, word_of
from flexmotion.streamer.motion.sequence import placed, poses_only, turned_to
from flexmotion.streamer.motion.targets import Target
from flexmotion.streamer.motion.undo import Undo


class ClipLibrary:
    """Plays one clip until a target names another, which begins at the human's position and heading.

    Args:
        clips: by name, all at one frame rate.
        first: name of the clip to begin with.

    Raises:
        ConfigError: there is no such clip, or the frame rates differ.
    """

    def __init__(self, clips: Mapping[str, Motion], first: str) -> None:
        rates = {name: clip.fps for name, clip in clips.items()}
        if len(set(rates.values())) > 1:
            raise ConfigError(f"clips: expected one frame rate, found {rates}")
        self.clips, self.first = dict(clips), first
        self.name, self.fps = f"clips:{len(clips)}", self._clip(first).fps
        self._start, self._playing = 0, poses_only(self._clip(first))

    def turn_to(self, target: Target, frame: int, played: Motion | None, yaw: float | None = None) -> None:
        """See `LiveSource.turn_to`. Raises `ConfigError` unless the target names one of the clips."""
        if not isinstance(target.intent, Clip):
            raise ConfigError(f"target: {word_of(target.intent)} cannot be followed, only clips are played here")
        clip = self._clip(target.intent.name)
        at = self._frame(frame) if played is None else played[len(played) - 1 :]
        if played is None and yaw is not None:
            at = turned_to(at, yaw)
        scale = at.body.standing_height / clip.body.standing_height
        self._start, self._playing = frame, placed(poses_only(clip), at, scale)

    def kept(self) -> Undo:
        """See `LiveSource.kept`."""
        return Undo(self)

    def window(self, first_frame: int, frames: int) -> Motion | None:
        """See `flexmotion.streamer.motion.sources.Source.window`."""
        first = max(first_frame - self._start, 0)
        cut = self._playing[first : first + frames]
        return cut if len(cut) >= 2 else None

    def _frame(self, frame: int) -> Motion:
        """The human at a frame; after the clip's end in its last pose."""
        place = min(max(frame - self._start, 0), len(self._playing) - 1)
        return self._playing[place : place + 1]

    def _clip(self, name: str) -> Motion:
        if name not in self.clips:
            raise ConfigError(f"target: unknown clip {name!r}, expected one of: {', '.join(sorted(self.clips))}")
        return self.clips[name]
