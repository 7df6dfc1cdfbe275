"""The text of `flexmotion emulate` at its end."""

from __future__ import annotations

from typing import Any

from flexmotion.streamer.commands.emulate import describe


def figures(**changed: Any) -> dict[str, Any]:
    bus = {"packets": 900, "bad_packets": 2, "collisions": 0, "wire_busy_share": 0.31, "spoilt": {"lost": 3, "late": 1}}
    told: dict[str, Any] = {
        "violations": 0,
        "false_readings": {},
        "fell": False,
        "lowest_height_share": 0.81,
        "steepest_tilt_rad": 0.1,
        "travelled_m": 0.35,
        "time_s": 9.0,
        "buses": {"main": bus, "imu": {"wire_busy_share": 0.4, "spoilt": {}}},
        "elapsed_s": 12.0,
        "processor_share": 0.2,
        "lateness_ms": 1.5,
        "lost_ms": 0.0,
    }
    return told | changed


def test_the_figures_are_text() -> None:
    """Regression: it printed dictionaries."""
    assert describe(figures(), 8.0).splitlines() == [
        "robot: did not fall, tilted by 5.7° at most, at its lowest 81 % of its height; 0.35 m from where it began; "
        "goals outside the envelope that arrived: 0",
        "main: 900 packets received, 2 of them broken, 0 collisions, wire busy 31 % of the time; "
        "injected faults: 3 lost, 1 late",
        "imu: wire busy 40 % of the time",
        "emulator: 12.0 s, 20 % of a processor; 1.5 ms late at worst while torque was on",
    ]


def test_a_late_emulator_explains_the_consequence() -> None:
    told = describe(figures(lateness_ms=47.0, lost_ms=120.0), 8.0)
    assert "47.0 ms late at worst while torque was on, 120 ms of physics given up" in told
    assert told.splitlines()[-1].startswith(
        "It was later than a tick, 8 ms: if the driver reports that servos do not answer"
    )


def test_refusals_are_counted_by_rule() -> None:
    bus = {"packets": 9, "bad_packets": 0, "collisions": 0, "wire_busy_share": 0.1, "spoilt": {}}
    told = describe(figures(buses={"main": bus | {"refused": {"eeprom_locked": 3, "tripped": 1}}}), 8.0)
    assert "wire busy 10 % of the time, refused: 3 eeprom_locked, 1 tripped" in told


def test_false_readings_are_counted() -> None:
    told = describe(figures(false_readings={"false_position": 7, "false_gyro": 2}), 8.0)
    assert "false readings: 7 position, 2 gyro" in told.splitlines()


def test_servos_on_a_bench_do_not_fall() -> None:
    kept = ("violations", "false_readings", "buses", "elapsed_s")
    bench = {key: value for key, value in figures().items() if key in kept}
    bench |= {"processor_share": 0.1, "lateness_ms": 0.1, "lost_ms": 0.0}
    assert describe(bench, 8.0).startswith("servos: goals outside the envelope that arrived: 0")


def test_lateness_is_compared_with_the_tick_of_the_emulated_robot() -> None:
    """Regression: it was compared with 8 ms for every robot."""
    told = figures(lateness_ms=12.0)
    assert "later than a tick, 10 ms" in describe(told, 10.0)
    assert "later than" not in describe(told, 20.0)
