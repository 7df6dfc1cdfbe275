"""Drive the simulated robot by a velocity: ahead, then a left turn, then a stand; prints where it is every two seconds.

python examples/drive_by_velocity.py
"""

from __future__ import annotations

from math import atan2, degrees

import flexmotion as fm

DRIVE = (
    (fm.Velocity(0.4, 0.0, 0.0), 6.0),  # forward, left [m/s], turning left [rad/s]; for how long [s]
    (fm.Velocity(0.2, 0.0, 0.5), 6.0),
    (fm.Text("stand still"), 2.0),
)


def main() -> None:
    with fm.open_session("op3", seed=1) as session:
        for target, seconds in DRIVE:
            session.send(target)
            print(target)
            for _ in range(round(seconds / 2.0)):
                session.advance(2.0)
                x, y, _z, qw, _qx, _qy, qz = session.state.torso
                heading = degrees(2.0 * atan2(qz, qw))
                print(f"  {session.state.time_s:4.1f} s  {x:5.2f} m ahead  {y:5.2f} m left  turned {heading:4.0f}°")
        session.finish()
    report = fm.outcome(session).report
    print(f"fell: {report.motion.fell}, steps: {report.motion.steps_planned}, ended {report.safety.final_state}")


if __name__ == "__main__":
    main()
