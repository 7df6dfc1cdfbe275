from __future__ import annotations

import logging
from importlib.metadata import EntryPoint

import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.drivers import plugins, registry
from flexmotion.drivers.sim.driver import SimDriver


@pytest.fixture
def plug_ins(monkeypatch: pytest.MonkeyPatch) -> list[EntryPoint]:
    """Entry points that a test adds as if they were installed."""
    installed: list[EntryPoint] = []
    monkeypatch.setattr(plugins, "entry_points", lambda group: tuple(installed))
    return installed


def plug_in(name: str, value: str) -> EntryPoint:
    return EntryPoint(name, value, registry.GROUP)


def test_built_in_drivers_are_found_without_an_installation(plug_ins: list[EntryPoint]) -> None:
    assert registry.names() == tuple(sorted(registry.BUILT_IN))
    assert registry.available()["sim"] is SimDriver


def test_an_installed_copy_of_a_built_in_driver_is_no_conflict(
    plug_ins: list[EntryPoint], caplog: pytest.LogCaptureFixture
) -> None:
    plug_ins.append(plug_in("sim", registry.BUILT_IN["sim"]))
    assert registry.available()["sim"] is SimDriver
    assert not caplog.records


@pytest.mark.parametrize(
    ("value", "says"),
    [
        ("no_such_package.driver:Robot", "does not load: ModuleNotFoundError"),
        ("flexmotion.drivers.sim.driver:NoSuchDriver", "does not load: AttributeError"),
        ("flexmotion.drivers.delay:DelayLine", "is no subclass of flexmotion.drivers.interface.Driver"),
    ],
)
def test_a_broken_plug_in_warns_and_the_rest_work(
    plug_ins: list[EntryPoint], caplog: pytest.LogCaptureFixture, op3: Robot, value: str, says: str
) -> None:
    plug_ins += [plug_in("broken", value), plug_in("another", "flexmotion.drivers.sim.driver:SimDriver")]
    with caplog.at_level(logging.WARNING):
        assert set(registry.available()) == {*registry.BUILT_IN, "another"}
    assert says in caplog.text and "'broken'" in caplog.text
    with pytest.raises(ConfigError, match=says):
        registry.create("broken", op3)


def test_no_plug_in_replaces_a_built_in_driver(plug_ins: list[EntryPoint], caplog: pytest.LogCaptureFixture) -> None:
    plug_ins.append(plug_in("sim", "somewhere.else:Robot"))
    assert registry.available()["sim"] is SimDriver
    assert "somewhere.else:Robot" in caplog.text


def test_create_checks_options(op3: Robot) -> None:
    driver = registry.create("sim", op3, kp_scale=0.9)
    assert isinstance(driver, SimDriver)
    with pytest.raises(ConfigError, match=r"options of driver 'sim': field kp: unknown field, expected one of: seed"):
        registry.create("sim", op3, kp=1.0)
    with pytest.raises(ConfigError, match="options of driver 'sim': field friction"):
        registry.create("sim", op3, friction=-1.0)


def test_an_unknown_driver_lists_the_known_ones(op3: Robot) -> None:
    with pytest.raises(ConfigError, match=r"unknown driver 'simm', expected one of: .*sim"):
        registry.create("simm", op3)
