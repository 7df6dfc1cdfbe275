"""`mirror_from`: lets a session receive frames of a person."""

from __future__ import annotations

from dataclasses import dataclass

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.mirror.service import PORT, MirrorService
from flexmotion.streamer.motion.mirror_source import MirrorSource
from flexmotion.streamer.run.session import Session


@dataclass(frozen=True)
class MirrorFrom:
    """Where frames of a person are received.

    Attributes:
        host, port: listened to, UDP; by default only this machine reaches it.
        token: that senders of other machines show first; needed where they reach the address.
        mapping: of the skeleton, a shipped name or a YAML file; None: found by the names of the joints.
    """

    host: str = "127.0.0.1"
    port: int = PORT
    token: str | None = None
    mapping: str | None = None


def mirror_from(session: Session, where: MirrorFrom) -> None:
    """Add the service to a session that has not begun.

    Raises:
        ConfigError: the source mirrors nobody, the clock is lockstep, the port is taken, or the address needs a token.
    """
    source = session.source
    if not isinstance(source, MirrorSource):
        raise ConfigError(f"{source.name}: a source that mirrors nobody; open_mirror gives one that does")
    if session.clock != "real":
        raise ConfigError("clock: lockstep passes as fast as it computes; frames of a person need clock real")
    session.services += (MirrorService(where.host, where.port, where.token, source.channel, where.mapping),)
