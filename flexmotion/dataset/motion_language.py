"""Captions and splits of motion-language sets in the layout of HumanML3D and KIT-ML.

new_joints/NAME.npy     positions
texts/NAME.txt          a line a sentence: `caption#tokens#start#end`, in seconds; 0 and 0 mean the whole clip
train.txt, val.txt, test.txt   names of the clips of each split

Names that begin with M are mirror images of others, with sentences of their own; a build mirrors clips itself and
leaves them out.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

from flexmotion.configs.errors import MotionFormatError
from flexmotion.dataset.captions import Caption

TEXTS = "texts"

SPLITS = {"train.txt": "train", "val.txt": "validation", "test.txt": "test"}
"""Lists of clips; `train_val.txt` and `all.txt` say nothing beside them."""

_MIRRORED = re.compile(r"M\d+\w*")


def is_text(path: Path) -> bool:
    """Whether a file has the sentences of one clip."""
    return path.suffix == ".txt" and path.parent.name == TEXTS


def is_split(path: Path) -> bool:
    """Whether a file lists the clips of a split."""
    return path.name in SPLITS and (path.parent / TEXTS).is_dir()


def is_mirror_image(path: Path) -> bool:
    """Whether a file of joints is the mirror image of another beside it."""
    return _MIRRORED.fullmatch(path.stem) is not None and path.with_name(path.name[1:]).is_file()


def read_texts(path: Path) -> list[Caption]:
    """Sentences of a clip; an end of 0 s is the clip's end.

    Raises:
        MotionFormatError: the file cannot be read or a line is invalid; names the line.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise MotionFormatError(f"{path}: cannot be read ({error})") from error
    return [_caption(path, number, line) for number, line in enumerate(lines, 1) if line.strip()]


def _caption(path: Path, number: int, line: str) -> Caption:
    # The sentence itself has no `#`; a line may lack the times.
    text, *rest = line.strip().split("#")
    times = rest[1:3] if len(rest) >= 3 else ["0", "0"]
    try:
        start, end = (0.0 if math.isnan(value := float(time)) else value for time in times)
    except ValueError as error:
        raise MotionFormatError(f"{path}, line {number}: {error}") from error
    if not 0 <= start <= end or not text.strip():
        raise MotionFormatError(
            f"{path}, line {number}: {line!r}, expected caption#tokens#start#end, 0 <= start <= end"
        )
    return Caption(start, end, text.strip(), path.parent.parent.name)


def read_split(path: Path) -> dict[str, dict[str, str]]:
    """Clip -> its split, as an index of clips has it.

    Raises:
        MotionFormatError: the file cannot be read.
    """
    try:
        names = path.read_text(encoding="utf-8").split()
    except (OSError, UnicodeDecodeError) as error:
        raise MotionFormatError(f"{path}: cannot be read ({error})") from error
    return {name: {"split": SPLITS[path.name]} for name in names}
