"""Sample human motion from the model that comes with FlexMotion: four seconds of words, window after window.

python examples/sample_motion.py "wave with the right hand" wave.npz
"""

from __future__ import annotations

import sys
from pathlib import Path

import flexmotion as fm


def main(prompt: str, file: Path) -> None:
    sampler = fm.open_sampler()
    motion = sampler.standing()  # the history of the first window
    while motion.duration < 4.0:
        window = sampler.sample(motion, fm.Condition(text=prompt), seed=len(motion))
        motion = fm.concatenate([motion, window])
    fm.save_motion(motion, file)
    print(f"{file}: {len(motion)} frames at {motion.fps:g} Hz, joints {motion.joints.shape} [rad]")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(sys.argv[1], Path(sys.argv[2]))
