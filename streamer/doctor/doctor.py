"""`examine`: whether this machine can run a robot, point by point."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import psutil
from pydantic import BaseModel, ConfigDict, Field

from flexmotion.bundles.bundle import Bundle
from flexmotion.bundles.shipped import bundle_folder, shipped_bundle
from flexmotion.compiled import unkept
from flexmotion.configs.errors import FlexMotionError
from flexmotion.configs.stream import Gateway
from flexmotion.streamer.doctor import devices, machine
from flexmotion.streamer.doctor.finding import Finding, fine, problem, warning

SCHEMA = "flexmotion.doctor/1"
_LONGEST_COMMAND = 80


class Examination(BaseModel):
    """All findings.

    Attributes:
        ok: whether there is no problem; warnings are none.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)

    schema_: str = Field(default=SCHEMA, alias="schema")
    ok: bool
    findings: tuple[Finding, ...]


def examine(settings: Gateway, bundle: str | Path | None = None, root: Path = Path("/")) -> Examination:
    """Look at everything.

    Args:
        settings: with the ports of a run.
        bundle: name or folder of the model; None: the one that comes with the project.
        root: of the file system.
    """
    found = tuple(_findings(settings, bundle, root))
    return Examination(ok=all(one.level != "problem" for one in found), findings=found)


def _findings(settings: Gateway, bundle: str | Path | None, root: Path) -> Iterator[Finding]:
    yield machine.scheduling()
    yield machine.locked_memory()
    yield machine.processors()
    yield machine.governor(root)
    yield machine.wake_latency(root)
    yield machine.realtime_share(root)
    yield machine.memory()
    yield machine.disk(Path.cwd())
    yield from machine.clocks(root)
    yield from devices.serial_ports(root)
    yield devices.input_devices(root)
    yield compiled_loops()
    yield model(bundle)
    yield network_port("port for targets", settings.port, "--web-port")
    yield network_port("port for stops", settings.stop_port, "--stop-port")


def compiled_loops() -> Finding:
    """Whether the code of inner loops is kept between starts; what is missing is compiled."""
    # Loading them compiles the loops of plans and of the model.
    import_module("flexmotion.retarget.retargeter")
    import_module("flexmotion.sampling.sampler")
    if not unkept():
        return fine("compiled loops", "their code is kept between starts")
    return warning(
        "compiled loops",
        "their code cannot be kept: every start takes about a minute longer",
        'export NUMBA_CACHE_DIR="$HOME/numba"',
    )


def model(bundle: str | Path | None) -> Finding:
    """Whether the model's bundle is there and whole."""
    try:
        folder = shipped_bundle() if bundle is None else bundle_folder(bundle)
        if folder is None:
            return warning("model bundle", "this version comes without one: clips are followed, words are not")
        opened = Bundle(folder)
    except (FlexMotionError, OSError) as error:
        return problem("model bundle", str(error), "pip install --force-reinstall --no-deps flexmotion")
    return fine("model bundle", f"{opened.manifest.name}, hash {opened.hash}")


def network_port(name: str, port: int, option: str) -> Finding:
    """Whether a port can be listened on; else which process does, and what to do.

    What is advised ends no process: it may be a run, with a robot that stands.

    Args:
        option: of `flexmotion run`, to take another one.
    """
    with socket.socket() as listening:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind(("127.0.0.1", port))
        except OSError as error:
            owner = _owner(port)
            whose = f"process {owner} uses it ({_command(owner)})" if owner else error.strerror or str(error)
            mend = f"flexmotion run … {option} {_free_port()}  # or end the other program, if it is yours"
            return warning(f"{name} {port}", f"{whose}: another run needs another one", mend)
    return fine(f"{name} {port}", "free")


def _free_port() -> int:
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        return int(listening.getsockname()[1])


def _command(process: int) -> str:
    """What a process runs, in short."""
    try:
        words = psutil.Process(process).cmdline()
    except psutil.Error:
        return "ended meanwhile"
    return " ".join(words)[:_LONGEST_COMMAND] or "without a command line"


def _owner(port: int) -> int | None:
    """The process that listens on a port; None where this user may not see it."""
    try:
        found = psutil.net_connections("tcp")
    except psutil.AccessDenied:
        return None
    return next(
        (one.pid for one in found if one.status == psutil.CONN_LISTEN and one.laddr and one.laddr.port == port), None
    )
