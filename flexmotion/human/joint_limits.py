"""Range of every joint of the human."""

from __future__ import annotations

from functools import lru_cache
from importlib import resources

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.schema import yaml_content
from flexmotion.human.skeleton import JOINTS


@lru_cache
def joint_limits() -> NDArray[np.float64]:
    """Least and greatest angle of every joint, (26, 2) [rad], in the order of `skeleton.JOINTS`."""
    text = resources.files("flexmotion").joinpath("data", "joint_limits.yaml").read_text(encoding="utf-8")
    table = yaml_content(text)
    limits = np.radians([table[name] if name in table else table[name[:-2]] for name in JOINTS])
    limits.flags.writeable = False
    return limits
