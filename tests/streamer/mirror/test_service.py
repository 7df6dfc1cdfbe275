"""The process that receives frames: its socket, and its end."""

from __future__ import annotations

import socket
import time

import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.mirror.clip_frames import clip_frames
from flexmotion.streamer.mirror.service import MirrorService
from flexmotion.streamer.motion.person_channel import PersonChannel, pose_of

from ...waiting import wait_until
from .mirror_frames import shipped


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as trial:
        trial.bind(("127.0.0.1", 0))
        return int(trial.getsockname()[1])


def test_frames_that_are_sent_become_poses() -> None:
    channel, port = PersonChannel(), free_port()
    service = MirrorService("127.0.0.1", port, None, channel)
    reader, step = channel.reader(), service.follow()
    frames, begin, rows = clip_frames(shipped(2.0)), time.perf_counter(), []
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sender.sendto(b"\x00", ("127.0.0.1", port))

    def arrived() -> bool:
        while frames and time.perf_counter() >= begin + frames[0][0]:
            sender.sendto(frames.pop(0)[1], ("127.0.0.1", port))
        step(False)
        rows.extend(reader.read())
        return len(rows) >= 10

    wait_until(arrived, "poses")
    step(True)
    sender.close()
    service.end()
    assert pose_of(rows[0]).motion.body.height == pytest.approx(shipped(0.1).body.height, rel=0.1)
    MirrorService("127.0.0.1", port, None, channel).end()  # the port is free again


def test_a_port_that_is_taken_is_named() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        with pytest.raises(ConfigError, match=f"--mirror: 127.0.0.1:{port} cannot be listened on"):
            MirrorService("127.0.0.1", port, None, PersonChannel())
