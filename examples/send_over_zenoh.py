"""Steer a robot over zenoh, as one operator of several, and print what became of each target.

flexmotion dry-run --zenoh           (in one terminal)
python examples/send_over_zenoh.py   (in another one; with an ENDPOINT, if the run or its router is not on this machine)

With a router the run has a token: set FLEXMOTION_TOKEN for both. Messages prove it and do not show it.
"""

from __future__ import annotations

import sys

import flexmotion as fm

TARGETS = (
    {"type": "take"},  # from another operator
    {"type": "text", "text": "wave with the right hand"},
    {"type": "velocity", "velocity": [0.2, 0.0, 0.4], "ttl_s": 1.0},  # forward, left [m/s], turning left [rad/s]
)


def main(endpoints: list[str]) -> None:
    with fm.ZenohClient(*endpoints, robot="op3", source="alice") as robot:
        for target in TARGETS:
            answer = robot.ask(target)
            print(f"{target['type']:9}{answer.state:11}{answer.heard_as or '-'}  {answer.reason or ''}")
        print(robot.status()["operator"])
        print(robot.stop().state)  # by the stop process: needs neither token nor gateway


if __name__ == "__main__":
    main(sys.argv[1:])
