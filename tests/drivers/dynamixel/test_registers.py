from __future__ import annotations

import itertools

import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.servo import catalogue
from flexmotion.drivers.dynamixel.registers import open_cr, table_of

MODELS = sorted(name for name, servo in catalogue().items() if servo.protocol == "dynamixel2")


@pytest.mark.parametrize("model", MODELS)
def test_every_dynamixel_of_the_catalogue_has_a_consistent_table(model: str) -> None:
    table = table_of(model)
    spans = sorted((register.address, register.end, name) for name, register in table.registers.items())
    if not table.keeps_indirect:  # else they are registers like others
        spans += [(run.address, run.address + 2 * run.count, "indirect") for run in table.indirect]
    spans += [(run.data, run.data + run.count, "indirect data") for run in table.indirect]
    for (_, end, name), (start, _, other) in itertools.pairwise(sorted(spans)):
        assert end <= start, f"{name} runs into {other}"
    for name, register in table.registers.items():
        assert register.unpack(register.pack(register.initial)) == register.initial, name
        if register.range is not None and register.access == "rw":
            assert register.range[0] <= register.initial <= register.range[1], name


def test_model_numbers_are_unique() -> None:
    numbers = [catalogue()[model].model_number for model in MODELS]
    assert None not in numbers
    assert len(set(numbers)) == len(numbers)
    assert catalogue()["XM430-W350"].model_number == 1020


def test_current_registers_exist_where_the_servo_measures_current() -> None:
    for model in MODELS:
        assert ("goal_current" in table_of(model)) == (catalogue()[model].current_unit is not None), model


def test_addresses_of_the_manual() -> None:
    table = table_of("XM430-W350")
    assert [table[name].address for name in ("torque_enable", "goal_position", "present_position")] == [64, 116, 132]
    assert table_of("XL330-M288").indirect[0].data == 208
    assert open_cr().table["gyro_x"].address == 32


def test_an_unknown_servo_lists_the_known_ones() -> None:
    with pytest.raises(ConfigError, match="no control table for servo 'AX-12'"):
        table_of("AX-12")
