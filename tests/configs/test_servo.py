import math
from pathlib import Path

import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.schema import parse
from flexmotion.configs.servo import Family, Servo, catalogue, find_servo


def test_the_catalogue_has_the_families_of_three_protocols() -> None:
    assert {servo.protocol for servo in catalogue().values()} == {"dynamixel2", "feetech", "lx16a"}
    assert {"XM430-W350", "XL330-M288", "2XC430-W250", "XW540-T260", "STS3215-12V", "LX-16A"} <= set(catalogue())


PLAUSIBLE = {"dynamixel_p": (50.0, 0.2, 0.8)}
"""Greatest torque [N·m], least and greatest error at full torque [degrees]; else those of small servos."""


@pytest.mark.parametrize("servo", catalogue().values(), ids=lambda servo: servo.name)
def test_every_figure_has_a_source_and_is_plausible(servo: Servo) -> None:
    for figure in servo.figures():
        assert servo.provenance[figure].text
    assert servo.provenance["stall_temperature_rise"].assumption  # no published figure
    assert not servo.provenance["stall_torque"].assumption
    most, stiffest, softest = PLAUSIBLE.get(servo.family, (12.0, 5.0, 20.0))
    assert 0.1 < servo.stall_torque < most
    assert 0.4 < servo.usable_torque / servo.stall_torque <= 1
    assert stiffest < servo.stall_torque / servo.kp * 180 / math.pi < softest


def test_figures_of_the_op3_servo_follow_from_the_datasheet() -> None:
    servo = find_servo("XM430-W350")
    assert servo.stall_torque == 4.1
    assert servo.no_load_speed == pytest.approx(46 * 2 * math.pi / 60)
    assert servo.back_emf == pytest.approx(0.854, rel=5e-3)
    full_supply_error = 885 / (800 / 128) * servo.tick_rad
    assert servo.kp == pytest.approx(servo.stall_torque / full_supply_error, rel=1e-3)
    assert servo.range == pytest.approx((-math.pi, math.pi), abs=2e-3)


def test_lx16a_turns_240_degrees() -> None:
    low, high = find_servo("LX-16A").range
    assert math.degrees(high - low) == pytest.approx(240)


def test_an_unknown_servo_names_the_closest() -> None:
    with pytest.raises(ConfigError, match=r"unknown servo 'XM430-W530', did you mean: .*XM430-W350"):
        find_servo("XM430-W530")


def family(**changes: object) -> Family:
    servo = find_servo("XM430-W350")
    figures = servo.model_dump(exclude={"name", "family", "protocol", "provenance"}, exclude_none=True) | changes
    content = {
        "protocol": "dynamixel2",
        "sources": {"here": {"text": "a test"}},
        "provenance": dict.fromkeys(figures, "here"),
        "defaults": figures,
        "servos": {"S": {}},
    }
    return parse(Family, content, "family")


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"usable_torque": 5.0}, "usable_torque 5.0 exceeds stall_torque 4.1"),
        ({"max_voltage": 9.0}, "voltages must be ordered"),
        ({"max_tick": 100}, "ticks must be ordered"),
        ({"kp": -1.0}, "field kp: -1.0, expected more than 0"),
    ],
)
def test_a_contradictory_servo_is_refused(changes: dict[str, float], says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        family(**changes).servo("S", Path("family.yaml"))


def test_a_figure_without_a_source_is_refused() -> None:
    made = family()
    del made.provenance["kp"]
    with pytest.raises(ConfigError, match="no source for kp"):
        made.servo("S", Path("family.yaml"))
    made.provenance["kp"] = "hearsay"
    with pytest.raises(ConfigError, match="unknown source 'hearsay', expected one of: here"):
        made.servo("S", Path("family.yaml"))
