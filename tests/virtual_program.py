"""The program on virtual time: `python tests/virtual_program.py run ...` is `flexmotion run ...`."""

from virtual_time import virtual_time

from flexmotion.streamer.__main__ import main

if __name__ == "__main__":
    with virtual_time():
        main()
