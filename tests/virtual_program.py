"""The program on virtual time: `python tests/virtual_program.py run ...` is `flexmotion run ...`.

Making a plan takes about as long as on a small computer. With the environment variable FASTEST time passes no faster
than so many seconds a second.
"""

import os

from virtual_time import Costs, virtual_time

from flexmotion.streamer.__main__ import main

if __name__ == "__main__":
    with virtual_time(float(os.environ.get("FASTEST", "inf")), Costs(plan_s=0.02, checkpoint_s=0.001)):
        main()
