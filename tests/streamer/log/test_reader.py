"""Reading logs: whole and cut off, with another decoder, and files that are no logs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove import Context, open_mcap
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.log.reader import read_log

NUMBERS = {
    "q",
    "q_cmd",
    "zmp_ref",
    "foot_ref",
    "true_foot_force",
    "repairs",
    "stale",
    "contact_ref",
    "must_stop",
    "state",
}


def test_the_log_holds_the_whole_record(logged: Any) -> None:
    record, log = logged.session.record, read_log(logged.path)
    assert log.whole and log.gaps == 0
    for name in record.rows.dtype.names:
        np.testing.assert_array_equal(log.rows[name], record.rows[name], err_msg=name)
    assert log.events == list(record.events) and log.record().plans == record.plans
    assert [event.message for event in log.events if event.kind == "request"] == ["END"]
    assert [plan["id"] for plan in log.plans] == list(range(1, logged.session.plans.newest_id + 1))
    assert [target["clip"] for target in log.targets] == ["wave"]
    robot = logged.session.robot
    legs = {joint for side in ("left", "right") for joint in robot.chain(f"{side}_leg").values()}
    above = [joint for joint in range(robot.n) if joint not in legs]
    played = [plan for plan in log.plans if plan["id"] in record.rows["plan"]]
    for plan in played:
        tick = plan["start_tick"] + 1
        row = record.rows[tick]
        if row["plan"] == plan["id"] and row["state"] == State.STREAMING:
            away = np.abs(plan["q"].reshape(plan["rows"], -1)[1] - row["q_ref"])
            # A leg that is set down ahead leaves its plan for its heel to land first.
            assert away[above].max() < 1e-6 and away.max() <= 0.15 + 1e-6
    header = log.header
    assert header.joints == logged.session.robot.joint_names and header.settings == logged.session.settings
    assert header.start_ns - header.wall_minus_perf_ns < log.rows["stamp_ns"][0]
    assert log.changed_files(logged.session.robot) == []


def test_another_decoder_reads_the_same_numbers(logged: Any) -> None:
    record = logged.session.record
    with open(logged.path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        messages = [(message, decoded) for _, _, message, decoded in reader.iter_decoded_messages(topics=["/tick"])]
        plans = [decoded for *_, decoded in reader.iter_decoded_messages(topics=["/plan"])]
    assert len(messages) == record.used
    for row, (_, decoded) in zip(record.rows[::50], messages[::50], strict=True):
        for name in NUMBERS:
            np.testing.assert_array_equal(np.ravel(getattr(decoded, name)), np.ravel(row[name]), err_msg=name)
    # In lockstep log time follows the ticks at the robot's rate.
    np.testing.assert_allclose(np.diff([message.log_time for message, _ in messages]) * 1e-9, 1 / 125, rtol=1e-6)
    assert plans[0].rows * plans[0].joints == len(plans[0].q) == len(plans[0].torque)


@pytest.mark.parametrize("share", [0.9, 0.5, 0.2])
def test_a_log_that_was_cut_off_is_read_as_far_as_it_goes(logged: Any, tmp_path: Path, share: float) -> None:
    content = logged.path.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(content[: int(share * len(content))])
    log, record = read_log(cut), logged.session.record
    assert not log.whole
    assert 0 < len(log.rows) < record.used
    np.testing.assert_array_equal(log.rows["q"], record.rows["q"][: len(log.rows)])


@pytest.mark.parametrize("cut", [1, 8, 9, 200, 700, 1400])
def test_a_log_that_lost_its_index_is_read_whole(logged: Any, tmp_path: Path, cut: int) -> None:
    """One that was cut off in its index, by one byte or a thousand, was "damaged, or not a log of FlexMotion"."""
    path = tmp_path / "cut.mcap"
    path.write_bytes(logged.path.read_bytes()[:-cut])
    log = read_log(path)
    assert log.whole
    np.testing.assert_array_equal(log.rows["q"], logged.session.record.rows["q"])


@pytest.mark.parametrize("place", [-1, -10, -25, -300, -1000])
def test_a_log_with_a_damaged_index_is_read_whole(logged: Any, tmp_path: Path, place: int) -> None:
    """It was refused for a byte that none of its data needs."""
    path, content = tmp_path / "damaged.mcap", bytearray(logged.path.read_bytes())
    content[place] ^= 0xFF
    path.write_bytes(content)
    assert len(read_log(path).rows) == logged.session.record.used


def test_a_log_of_an_older_row_is_read_by_name(logged: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from flexmotion.streamer.control import tick_row
    from flexmotion.streamer.log import reader

    full = tick_row.TickRow.dtype(joints=logged.session.robot.n)
    newer = np.dtype([("later", "f8", 2), *((name, full[name]) for name in full.names if name != "tilt")])
    monkeypatch.setattr(reader.TickRow, "dtype", lambda joints: newer)
    rows = read_log(logged.path).rows
    assert np.isnan(rows["later"]).all()
    np.testing.assert_array_equal(rows["q"], logged.session.record.rows["q"])


def damaged(content: bytes) -> bytes:
    middle = len(content) // 2
    return content[:middle] + bytes(b ^ 0xFF for b in content[middle : middle + 64]) + content[middle + 64 :]


@pytest.mark.parametrize(
    ("spoil", "expected"),
    [
        (lambda content: content[:4], "damaged, or not a log of FlexMotion"),
        (lambda content: content[:40], "no log of FlexMotion"),
        (lambda content: b"", "no log of FlexMotion"),
        (lambda content: b"HIERARCHY\nROOT Hips\n" * 20, "damaged, or not a log of FlexMotion"),
        (damaged, "damaged, or not a log of FlexMotion"),
    ],
    ids=["magic", "header", "empty", "text", "damaged"],
)
def test_a_file_that_is_no_log_is_one_line(
    logged: Any, tmp_path: Path, spoil: Callable[[bytes], bytes], expected: str
) -> None:
    file = tmp_path / "spoilt.mcap"
    file.write_bytes(spoil(logged.path.read_bytes()))
    with pytest.raises(ConfigError, match=f"spoilt.mcap: {expected}") as caught:
        read_log(file)
    assert "\n" not in str(caught.value)


def test_the_log_of_another_program(tmp_path: Path) -> None:
    file = tmp_path / "foreign.mcap"
    open_mcap(file, context=Context()).close()
    with pytest.raises(ConfigError, match=r"foreign.mcap: no log of FlexMotion, it has no metadata record"):
        read_log(file)


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none.mcap: cannot be read \(No such file"):
        read_log(tmp_path / "none.mcap")
