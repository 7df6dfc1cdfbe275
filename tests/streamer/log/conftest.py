"""A logged run for several tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.registry import create
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.log.recorder import Recorder
from flexmotion.streamer.log.recording import record_to
from flexmotion.streamer.motion.clip_library import ClipLibrary
from flexmotion.streamer.motion.intents import Clip
from flexmotion.streamer.motion.sources import ClipSource, Source
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

SEED = 3
TARGET_TICK, END_TICK = 260, 420
SETTINGS = load_stream()


@dataclass
class Logged:
    """A session and its recorder."""

    session: Session
    recorder: Recorder

    @property
    def path(self) -> Path:
        return self.recorder.path


@pytest.fixture(scope="session")
def logged_session() -> Callable[..., Logged]:
    """Function (path, source, clock, session's fields ...) -> session with a recorder, before its run."""
    robot = load_robot("op3")

    def make(path: Path, source: Source | None = None, clock: str = "lockstep", **options: Any) -> Logged:
        source = ClipSource(default_clip()[225:290]) if source is None else source
        given = {"settings": SETTINGS, "clock": clock, **options}
        session = Session(robot, create("sim", robot, seed=SEED), source, seed=SEED, **given)
        return Logged(session, record_to(path, session, clock))

    return make


@pytest.fixture(scope="session")
def logged(logged_session: Callable[..., Logged], tmp_path_factory: pytest.TempPathFactory) -> Logged:
    """A finished lockstep run with a target and a request for the end; treat as read-only."""
    clips = {"steps": default_clip()[225:400], "wave": default_clip()[:120]}
    made = logged_session(tmp_path_factory.mktemp("log") / "run.mcap", ClipLibrary(clips, "steps"))
    session = made.session

    def operate() -> Request | None:
        assert session.loop is not None
        tick = session.loop.tick_count
        if tick == TARGET_TICK:
            session.targets.send(Clip("wave"))
        return Request.END if tick == END_TICK else None

    session.next_request = operate
    session.run()
    return made
