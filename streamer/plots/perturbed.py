"""Picture of a simulated variant: the human before, during and after the push, its forces and the assistance."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from flexmotion.biomechanics.simulation.variant import PerturbedMotion
from flexmotion.human.kinematics import forward
from flexmotion.human.skeleton import SIDES
from flexmotion.spatial.gravity import GRAVITY

POSES = 12
"""Number of poses in the strip."""

APART = 0.55
"""Distance of the poses in the strip [m]."""


def plot_perturbed(answer: PerturbedMotion, path: Path) -> None:
    """Write a picture: poses from the right side and from behind, forces over time."""
    found, motion = answer.dynamics, answer.dynamics.motion
    assert motion.wrenches is not None
    weight, times = motion.body.mass * GRAVITY, np.arange(len(motion)) / motion.fps
    figure, axes = plt.subplots(
        5, 1, figsize=(11, 12), layout="constrained", gridspec_kw={"height_ratios": [3, 3, 2, 2, 2]}
    )
    for place, across, title in ((axes[0], 0, "from the right"), (axes[1], 1, "from behind")):
        _strip(place, answer, across)
        place.set_ylabel(f"{title} [m]")
    axes[2].plot(times, motion.wrenches[..., 2] / weight, label=("left foot", "right foot"))
    axes[2].set_ylabel("vertical ground force\n[body weights]")
    for load in found.loads:
        axes[3].plot(times, np.linalg.norm(load.force, axis=1) / weight, label=load.segment)
    axes[3].set_ylabel("external load\n[body weights]")
    axes[4].plot(times, 100 * answer.assistance, label=("assistance, force", "assistance, moment per leg"))
    axes[4].plot(times, 100 * found.residual[:, 0], "k:", label="residual force of the labels")
    axes[4].set_ylabel("root [% of body weight]")
    for place in axes[2:]:
        place.set_xlim(0, max(times[-1], 1e-3))
        place.grid(alpha=0.3)
        place.legend(loc="upper right", ncols=3, fontsize="small")
        if answer.perturbation.push:
            place.axvspan(answer.perturbation.start_s, answer.perturbation.end_s, alpha=0.2, color="tab:red")
    axes[4].set_xlabel("time [s]; red: push")
    figure.savefig(path, dpi=90)
    plt.close(figure)


def _strip(place: Axes, answer: PerturbedMotion, across: int) -> None:
    """Stick figures at even times, beside one another; `across` is the world axis that is drawn horizontally."""
    motion, push = answer.dynamics.motion, answer.dynamics.loads[0].force
    human = forward(motion)
    largest = np.linalg.norm(push, axis=1).max()
    for number, frame in enumerate(np.linspace(0, len(motion) - 1, POSES).round().astype(int)):
        sign = 1.0 if across == 0 else -1.0
        origin = human.pelvis_position[frame, across]

        def drawn(
            *points: np.ndarray, colour: str, number: int = number, origin: float = origin, sign: float = sign
        ) -> None:
            line = np.array(points)
            place.plot(APART * number + sign * (line[:, across] - origin), line[:, 2], colour, linewidth=1.5)

        middle = human.shoulder[frame].mean(axis=0)
        drawn(human.pelvis_position[frame], middle, human.vertex[frame], colour="0.3")
        for side, _ in enumerate(SIDES):
            colour = ("tab:blue", "tab:orange")[side]
            leg = (human.hip, human.knee, human.ankle, human.heel, human.toe)
            drawn(human.pelvis_position[frame], *(joint[frame, side] for joint in leg), colour=colour)
            arm = (human.shoulder, human.elbow, human.hand)
            drawn(middle, *(joint[frame, side] for joint in arm), colour=colour)
        if largest > 0 and np.linalg.norm(push[frame]) > 0.1 * largest:
            size = 0.4 * push[frame, across] / largest * sign
            place.annotate(
                "",
                (APART * number, middle[2]),
                (APART * number - size, middle[2]),
                arrowprops={"arrowstyle": "->", "color": "tab:red"},
            )
        place.text(APART * number, -0.12, f"{frame / motion.fps:.1f} s", ha="center", fontsize="small")
    place.set_aspect("equal")
    place.set_xticks([])
