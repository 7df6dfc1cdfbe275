"""Entry point of the script `flexmotion` and of `python -m flexmotion.streamer`."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType
from typing import NoReturn

from flexmotion.streamer.commands.exit_codes import INTERRUPTED


def main() -> NoReturn:
    """Run the command line and exit with its code."""
    # An interrupt during the imports ends the program without a traceback; there is nothing to clean up yet.
    before = signal.getsignal(signal.SIGINT)
    if before is not signal.SIG_IGN:  # under nohup, or & in a script, SIGINT stays ignored
        signal.signal(signal.SIGINT, _leave)
    from flexmotion.streamer.cli import execute

    signal.signal(signal.SIGINT, before)
    sys.exit(execute())


def _leave(_number: int, _frame: FrameType | None) -> NoReturn:
    os._exit(INTERRUPTED)


if __name__ == "__main__":
    main()
