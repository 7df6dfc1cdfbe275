"""Where the program begins: the script `flexmotion`, and `python -m streamer`."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType
from typing import NoReturn

from flexmotion.streamer.commands.exit_codes import INTERRUPTED


def main() -> NoReturn:
    """Run the command line and exit with its code."""
    # An exception in the middle of an import is somebody else's to print; there is nothing to clean up yet.
    before = signal.getsignal(signal.SIGINT)
    if before is not signal.SIG_IGN:  # nohup, or & in a script: it is to go on
        signal.signal(signal.SIGINT, _leave)
    from flexmotion.streamer.cli import execute

    signal.signal(signal.SIGINT, before)
    sys.exit(execute())


def _leave(_number: int, _frame: FrameType | None) -> NoReturn:
    os._exit(INTERRUPTED)


if __name__ == "__main__":
    main()
