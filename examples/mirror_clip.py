"""Play a clip over the wire, as a camera would send the person in it.

flexmotion dry-run --mirror --view                  (in one terminal)
python examples/mirror_clip.py walk.bvh             (in another one)
python examples/mirror_clip.py walk.bvh mediapipe   (as MediaPipe's landmarks instead of named joints)

Without a clip at hand, the model makes one: python examples/sample_motion.py "walk forward" walk.npz
"""

from __future__ import annotations

import socket
import sys
import time

import flexmotion as fm

ADDRESS = ("127.0.0.1", 39539)


def main(file: str, protocol: str) -> None:
    frames = fm.clip_frames(fm.load_motion(file), protocol)
    begin = time.perf_counter()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for at, datagram in frames:
            time.sleep(max(begin + at - time.perf_counter(), 0.0))
            sender.sendto(datagram, ADDRESS)
    print(f"sent {len(frames)} frames in {time.perf_counter() - begin:.1f} s to port {ADDRESS[1]}")


if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1].startswith("-"):
        sys.exit(__doc__)
    try:
        main(sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else "joints")
    except fm.FlexMotionError as error:
        sys.exit(str(error))
