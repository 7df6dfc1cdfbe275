"""Send targets to a run from another program, and print what became of them.

flexmotion dry-run --web          (in one terminal)
python examples/send_targets.py   (in another one; --port, if the run has another than 8790)
"""

from __future__ import annotations

import sys

import flexmotion as fm

TARGETS = (
    {"type": "text", "text": "wave with the right hand"},
    {"type": "velocity", "velocity": [0.3, 0.0, 0.0], "ttl_s": 1.0},  # forward, left [m/s], turning left [rad/s]
    {"type": "text", "text": "fly to the moon"},
    {"type": "hold"},
)


def main(port: int) -> None:
    with fm.Client(port=port, source="example") as robot:
        for target in TARGETS:
            answer = robot.ask(target)
            print(f"{target['type']:9}{answer.state:11}{answer.heard_as or '-'}  {answer.reason or ''}")
        print(robot.status()["state"])
        robot.release()  # else no other program may steer for the next ten seconds


if __name__ == "__main__":
    main(int(sys.argv[2]) if sys.argv[1:2] == ["--port"] else 8790)
