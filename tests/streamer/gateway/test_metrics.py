"""`/metrics`: read by Prometheus' own parser; who may read it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from http.client import HTTPConnection

import pytest
from prometheus_client import Metric
from prometheus_client.parser import text_string_to_metric_families

from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import Gateway
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.telemetry import Telemetry
from flexmotion.streamer.gateway.admission import Admission
from flexmotion.streamer.gateway.ports import any_free
from flexmotion.streamer.gateway.service import GatewayService

from ...waiting import HANGING_S, wait_until
from .conftest import RATE, Answering, Run

TOKEN = "correct horse battery"


@pytest.fixture
def whole(op3: Robot) -> Run:
    """A run whose rows have a column for every joint."""
    return Run(Telemetry(op3.n, RATE))


@pytest.fixture
def begin(whole: Run, op3: Robot) -> Iterator[Callable[..., GatewayService]]:
    """Function (token) -> a gateway that listens, in this process."""
    ends: list[Callable[[bool], None]] = []

    def start(token: str | None = None) -> GatewayService:
        admission = Admission("127.0.0.1", token)
        service = GatewayService(
            op3, "sim", Gateway(), whole.telemetry, whole.targets, whole.heard, admission, port=any_free(), stop_port=1
        )
        ends.append(service.follow())
        wait_until(lambda: _answers(service.port), "the gateway to listen")
        return service

    yield start
    for end in ends:
        end(True)


def _answers(port: int) -> bool:
    try:
        get(port)
    except OSError:
        return False
    return True


def get(port: int, **headers: str) -> tuple[int, str]:
    connection = HTTPConnection("127.0.0.1", port, timeout=HANGING_S)
    connection.request("GET", "/metrics", headers=headers)
    response = connection.getresponse()
    content = response.read().decode()
    connection.close()
    return response.status, content


def families(text: str) -> dict[str, Metric]:
    return {family.name: family for family in text_string_to_metric_families(text)}


def test_prometheus_reads_the_run(begin: Callable[..., GatewayService], whole: Run, op3: Robot) -> None:
    gateway = begin()
    status, text = get(gateway.port)
    before = families(text)
    assert status == 200 and "flexmotion_ticks" not in before  # the loop has not begun
    row = whole.telemetry.row
    row.temperature[...] = 40.0
    row.temperature[2] = float("nan")
    row.missed_deadlines[...], row.tilt[...] = 3, (0.1, -0.2)
    whole.state = State.HOLD
    for _ in range(4):
        whole.step()
        row.temperature[...] = 40.0
        row.temperature[2] = float("nan")
        row.tilt[...] = 0.1, -0.2
    whole.step()
    found = families(get(gateway.port)[1])
    assert found["flexmotion_ticks"].samples[0].value == 5
    assert found["flexmotion_missed_deadlines"].samples[0].value == 3
    temperatures = {
        sample.labels["joint"]: sample.value for sample in found["flexmotion_servo_temperature_celsius"].samples
    }
    assert set(temperatures) == set(op3.joint_names) - {op3.joint_names[2]} and set(temperatures.values()) == {40.0}
    states = {sample.labels["flexmotion_ladder"]: sample.value for sample in found["flexmotion_ladder"].samples}
    assert [name for name, value in states.items() if value] == ["HOLD"]
    tilt = {sample.labels["axis"]: sample.value for sample in found["flexmotion_tilt_radians"].samples}
    assert tilt == {"roll": 0.1, "pitch": -0.2}
    assert found["flexmotion_run_info"].samples[0].labels == {"robot": "op3", "driver": "sim"}


def test_messages_are_counted_by_what_became_of_them(
    begin: Callable[..., GatewayService], answering: Callable[..., Answering]
) -> None:
    gateway = begin()
    connection = HTTPConnection("127.0.0.1", gateway.port, timeout=HANGING_S)
    connection.request("POST", "/text", b"[]")
    assert connection.getresponse().status == 422
    connection.close()
    found = families(get(gateway.port)[1])["flexmotion_messages"]
    counted = {sample.labels["state"]: sample.value for sample in found.samples}
    assert counted["received"] == 1 and counted["refused"] == 1


def test_metrics_need_the_token_and_a_known_host(begin: Callable[..., GatewayService]) -> None:
    gateway = begin(TOKEN)
    assert get(gateway.port)[0] == 401
    assert get(gateway.port, Authorization=f"Bearer {TOKEN}")[0] == 200
    assert get(gateway.port, Authorization=f"Bearer {TOKEN}", Host="evil.example")[0] == 403
    assert get(gateway.port, Authorization=f"Bearer {TOKEN}", Origin="http://evil.example")[0] == 403
