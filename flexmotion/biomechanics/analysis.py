"""`analyse`: one clip in full: ground forces and their error, joint moments, muscles, joint contact, figures."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.biomechanics.differentiation import EDGE
from flexmotion.biomechanics.dynamics import Dynamics, dynamics
from flexmotion.biomechanics.force_error import FLAGGED
from flexmotion.biomechanics.joint_contact import compression, joint_contact_forces, stance_peaks
from flexmotion.biomechanics.muscle_geometry import muscle_models, muscle_names
from flexmotion.biomechanics.plausibility import explained, plausible, within_turn
from flexmotion.biomechanics.smoothing import CUTOFF
from flexmotion.biomechanics.static_optimisation import MuscleState, infeasible, static_optimisation
from flexmotion.configs.errors import ConfigError, MotionFormatError
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS, SIDES
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.spatial.quaternions import continuous_quaternions

Float = NDArray[np.float64]

SHORTEST_S = 0.6
"""Least duration of a clip; in a shorter one the low-pass filter and its ends reach every frame [s]."""

SATURATED = 0.99
"""Activation of a saturated muscle."""


@dataclass(frozen=True)
class Recording:
    """Where a motion lies in its recording, for files that are compared with it.

    Attributes:
        start: time of the first frame [s].
        turn: about z, from the motion's axes to the recording's, those of which are x forward, y left, z up [rad].
        origin: of the motion's axes in the recording's, on the floor, (x, y) [m].
        belt: velocity of a treadmill's belt that was removed from the motion, in its axes, (x, y) [m/s].
    """

    start: float = 0.0
    turn: float = 0.0
    origin: tuple[float, float] = (0.0, 0.0)
    belt: tuple[float, float] = (0.0, 0.0)

    def placed(self, found: Dynamics) -> Dynamics:
        """The same as recorded: root, ground forces, centres of pressure; all other arrays are kept.

        On a belt, which moves at a constant velocity, forces are those over ground.
        """
        motion = found.motion
        assert motion.wrenches is not None and motion.torques is not None
        turn, times = Rotation.from_euler("z", self.turn), np.arange(len(motion))[:, None] / motion.fps

        def turned(vectors: Float) -> Float:
            return vectors @ turn.as_matrix().T

        shift = np.array([*self.origin, 0.0]) + turned(times * [*self.belt, 0.0])
        quaternions = turn * Rotation.from_quat(motion.root_quaternion, scalar_first=True)
        wrenches = np.concatenate([turned(motion.wrenches[..., :3]), turned(motion.wrenches[..., 3:])], axis=-1)
        placed = replace(
            motion,
            root_position=turned(motion.root_position) + shift,
            root_quaternion=continuous_quaternions(quaternions.as_quat(scalar_first=True)),
            wrenches=wrenches,
            torques=np.concatenate([turned(motion.torques[:, :3]), motion.torques[:, 3:]], axis=1),
        )
        return replace(found, motion=placed, centres=turned(found.centres) + shift[:, None])


UNMOVED = Recording()


@dataclass(frozen=True)
class MuscleAnalysis:
    """Muscles of a clip.

    Attributes:
        state: activations (T, M) and what muscles cannot produce.
        names: of the M muscles.
        legs: number of leg muscles, which come first.
        contact: force on the segment beyond each of `state.crossings`, in that segment's axes, (T, 7, 3) [N].
        infeasible: whether muscles cannot produce the torque of each of `state.joints`, (T, 13) bool.
    """

    state: MuscleState
    names: tuple[str, ...]
    legs: int
    contact: Float
    infeasible: NDArray[np.bool_]

    @property
    def saturated(self) -> NDArray[np.bool_]:
        """Whether each leg muscle is at its greatest activation, (T, `legs`)."""
        return self.state.activations[:, : self.legs] > SATURATED


@dataclass(frozen=True)
class ClipAnalysis:
    """A clip with its dynamics, and its muscles where computed.

    Attributes:
        dynamics: smoothed motion, ground forces, joint torques, residuals, force error.
        cutoff: of the low-pass filter [Hz].
        good: whether residual and joints are within their limits (see `plausibility`), (T,) bool.
        muscles: None where not computed.
        recording: where the motion lies in its recording.
    """

    dynamics: Dynamics
    cutoff: float
    good: NDArray[np.bool_]
    muscles: MuscleAnalysis | None = None
    recording: Recording = UNMOVED

    def __len__(self) -> int:
        return len(self.dynamics.motion)

    @property
    def times(self) -> Float:
        """Time of every frame, (T,) [s]."""
        return self.recording.start + np.arange(len(self)) / self.dynamics.motion.fps

    @property
    def weight(self) -> float:
        """Body weight [N]."""
        return self.dynamics.motion.body.mass * GRAVITY

    @property
    def forces(self) -> Float:
        """Ground forces on left and right foot, (T, 2, 3) [body weights]."""
        assert self.dynamics.motion.wrenches is not None
        return self.dynamics.motion.wrenches[..., :3] / self.weight

    @property
    def moments(self) -> Float:
        """Joint moments in the order of `JOINTS`, (T, 26) [N·m]."""
        assert self.dynamics.motion.torques is not None
        return self.dynamics.motion.torques[:, -len(JOINTS) :]

    @property
    def flagged(self) -> NDArray[np.bool_]:
        """Whether the force on left and right foot is likely to be wrong, (T, 2)."""
        return self.dynamics.force_error > FLAGGED

    @property
    def inner(self) -> slice:
        """Frames whose accelerations are known from both sides: all but `EDGE` at each end."""
        return slice(EDGE, -EDGE)

    @property
    def compression(self) -> Float:
        """Compression of every crossing along the segment, (T, 7) [body weights]."""
        assert self.muscles is not None
        return compression(self.muscles.contact, self.muscles.state.crossings, self.weight)

    def figures(self) -> dict[str, Any]:
        """Figures of a clip, as JSON content: forces in body weights, shares of frames in [0, 1].

        Peaks are those of the `inner` frames.
        """
        motion = self.dynamics.motion
        assert motion.contacts is not None
        content: dict[str, Any] = {
            "source": motion.source,
            "frames": len(self),
            "fps": motion.fps,
            "cutoff_hz": self.cutoff,
            "body": asdict(motion.body),
            "peak_vertical_force_bw": _by_side(self.forces[self.inner, :, 2].max(axis=0)),
            "force_error_mean_bw": _by_side(self.dynamics.force_error.mean(axis=0)),
            "flagged_share": float(self.flagged.any(axis=1).mean()),
            "good_share": float(self.good.mean()),
            "contact_share": float(motion.contacts.any(axis=1).mean()),
            "residual_force_median_bw": float(np.median(self.dynamics.residual[:, 0])),
            "residual_moment_median_bw_m": float(np.median(self.dynamics.residual[:, 1])),
            "peak_moment_nm_per_kg": {
                name: float(np.abs(self.moments[self.inner, column]).max() / motion.body.mass)
                for column, name in enumerate(JOINTS)
            },
        }
        if self.muscles is not None:
            content |= self._muscle_figures(self.muscles)
        return content

    def _muscle_figures(self, muscles: MuscleAnalysis) -> dict[str, Any]:
        shares = muscles.saturated.mean(axis=0)
        motion, crossings, pressed = self.dynamics.motion, muscles.state.crossings, self.compression
        assert motion.contacts is not None
        inner = np.zeros(len(self), bool)
        inner[self.inner] = True
        stance = stance_peaks(pressed, crossings, motion.contacts, self.good & inner, motion.fps)
        return {
            "peak_compression_bw": dict(zip(crossings, pressed[self.inner].max(axis=0).tolist(), strict=True)),
            "stance_compression_bw": {
                name: None if np.isnan(peak) else float(peak) for name, peak in zip(crossings, stance, strict=True)
            },
            "saturated_share": float(muscles.saturated.any(axis=1).mean()),
            "saturated_muscles": {
                muscles.names[column]: float(shares[column]) for column in np.argsort(-shares) if shares[column] > 0
            },
            "infeasible_share": float(muscles.infeasible.any(axis=1).mean()),
        }


def check_cutoff(cutoff: float, fps: float | None = None, name: str = "") -> None:
    """Check the cut-off of the low-pass filter [Hz].

    Args:
        cutoff: to check.
        fps: frame rate; None where it is not known yet [1/s].
        name: of the clip, for the message.

    Raises:
        ConfigError: it is not more than 0 and below half of the frame rate.
    """
    if not 0 < cutoff < (math.inf if fps is None else fps / 2):
        of = "half the frame rate" + (f" of {fps:g} Hz" if fps is not None else "")
        begin = f"{name}: " if name else ""
        raise ConfigError(f"{begin}cut-off is {cutoff:g} Hz, expected more than 0 and less than {of}")


def analyse(
    motion: Motion, cutoff: float = CUTOFF, *, muscles: bool = True, recording: Recording = UNMOVED
) -> ClipAnalysis:
    """Forces, moments, muscles and joint contact of one clip.

    Args:
        motion: kinematics over a floor at z = 0, and a body with the human's mass.
        cutoff: of the low-pass filter [Hz].
        muscles: with activations and joint contact, which need the extra `biomech`.
        recording: where the motion lies in its recording.

    Raises:
        MotionFormatError: the clip is too short.
        ConfigError: the cut-off is not below half the frame rate; `myo-sim` is not installed.
    """
    name = motion.source or "motion"
    check_cutoff(cutoff, motion.fps, name)
    if motion.duration < SHORTEST_S or len(motion) <= 2 * EDGE:
        least = max(SHORTEST_S, 2 * EDGE / motion.fps)
        raise MotionFormatError(f"{name}: lasts {motion.duration:.2f} s, expected at least {least:g} s")
    if muscles:
        # Missing models are reported before anything is computed.
        muscle_models()
    found = dynamics(motion, cutoff)
    good = explained(found.residual) & plausible(found.motion)
    return ClipAnalysis(found, cutoff, good, muscle_analysis(found) if muscles else None, recording)


def muscle_analysis(found: Dynamics) -> MuscleAnalysis:
    """Muscles of a motion with its dynamics; their models take angles within half a turn of each joint's middle."""
    moved = replace(found.motion, joints=within_turn(found.motion.joints))
    state = static_optimisation(moved)
    return MuscleAnalysis(
        state=state,
        names=muscle_names(),
        legs=sum(len(model.muscles) for model in muscle_models()[: len(SIDES)]),
        contact=joint_contact_forces(found, state),
        infeasible=infeasible(state, moved),
    )


def _by_side(values: Float) -> dict[str, float]:
    return dict(zip(("left", "right"), values.tolist(), strict=True))
