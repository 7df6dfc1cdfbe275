"""The program on virtual time: `python tests/virtual_program.py run ...` is `flexmotion run ...`.

With the environment variable FASTEST time passes no faster than so many seconds a second.
"""

import os

from virtual_time import virtual_time

from flexmotion.streamer.__main__ import main

if __name__ == "__main__":
    with virtual_time(float(os.environ.get("FASTEST", "inf"))):
        main()
