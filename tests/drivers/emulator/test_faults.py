from __future__ import annotations

import math

import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.drivers.emulator.body import BenchBody
from flexmotion.drivers.emulator.faults import PACKET_FAULTS, Damage, Fault, FaultKind
from flexmotion.drivers.emulator.loopback import Loopback

PACKET = bytes(range(20))


@pytest.mark.parametrize(
    ("text", "kind", "argument", "at", "seconds"),
    [
        ("lost", FaultKind.LOST, math.nan, -math.inf, math.inf),
        ("dead:14@2.5", FaultKind.DEAD, 14.0, 2.5, math.inf),
        ("voltage:9.5@1+0.5", FaultKind.VOLTAGE, 9.5, 1.0, 0.5),
    ],
)
def test_faults_as_text(text: str, kind: FaultKind, argument: float, at: float, seconds: float) -> None:
    fault = Fault.parse(text)
    assert (fault.kind, fault.at, fault.seconds) == (kind, at, seconds)
    assert fault.argument == argument or math.isnan(argument)


@pytest.mark.parametrize("text", ["", "fire", "dead", "dead:x", "lost@", "voltage:1.2.3", "lost@1+"])
def test_an_unknown_fault_lists_the_known_ones(text: str) -> None:
    with pytest.raises(ConfigError, match=r"fault .*(expected KIND|needs an argument|could not convert)"):
        Fault.parse(text)


def test_a_fault_acts_for_its_time_after_torque_went_on() -> None:
    fault = Fault.parse("cable@2+1")
    assert [fault.active(t) for t in (-1.0, 0.0, 2.0, 2.9, 3.0)] == [False, False, True, True, False]
    assert Fault.parse("cable").active(-1.0)


def test_each_fault_damages_packets_in_its_way() -> None:
    def spoil(text: str) -> tuple[bytes, float]:
        damage = Damage(seed=1)
        damage.act([Fault.parse(text)])
        return damage.spoil(PACKET)

    assert spoil("lost") == (b"", 0.0)
    assert spoil("late:0.03") == (PACKET, 0.03)
    assert spoil("duplicated") == (PACKET + PACKET, 0.0)
    cut, _ = spoil("truncated")
    assert len(cut) < len(PACKET) and PACKET.startswith(cut)
    wrong, _ = spoil("corrupt")
    assert sum((a ^ b).bit_count() for a, b in zip(wrong, PACKET, strict=True)) == 1


def test_random_damage_has_the_share_asked_for_and_every_kind() -> None:
    damage = Damage(bad_packets=0.05, seed=3)
    for _ in range(4000):
        damage.spoil(PACKET)
    assert sum(damage.spoilt.values()) == pytest.approx(200, abs=50)
    assert all(damage.spoilt[kind] for kind in PACKET_FAULTS)


def test_a_fault_of_an_unknown_device_is_refused(op3: Robot) -> None:
    """Regression: `--fault dead:99` was accepted and had no effect."""
    for text in ("dead:99", "overheat:99", "reset:200"):
        with pytest.raises(ConfigError, match="no servo has id"):
            Loopback(BenchBody(op3), faults=[Fault.parse(text)])
    for text in ("dead:14", "dead:200"):  # a servo, the controller board
        assert Loopback(BenchBody(op3), faults=[Fault.parse(text)]).emulator.faults
