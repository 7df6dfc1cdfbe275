"""`LogWriter`: writes messages and their schemas to an MCAP file (foxglove-sdk)."""

from __future__ import annotations

from collections.abc import Mapping

import foxglove
from foxglove import Context
from foxglove.mcap import MCAPCompression, MCAPWriteOptions

from flexmotion.streamer.log.channels import Channels
from flexmotion.streamer.log.header import SCHEMA, LogHeader
from flexmotion.streamer.log.log_file import LogFile

_MEDIA_TYPES = {".npz": "application/x-npz", ".xml": "application/xml", ".yaml": "application/yaml"}


class LogWriter(Channels):
    """Topics of one log, each with its schema; times are nanoseconds since the epoch.

    Args:
        attachments: files to store in the log, by name.
    """

    def __init__(self, file: LogFile, header: LogHeader, attachments: Mapping[str, bytes]) -> None:
        self.file = file
        # A context of its own keeps apart several logs in one process; its channels close with it.
        context = self._context = Context()
        options = MCAPWriteOptions(
            compression=MCAPCompression.Zstd,
            compression_threads=0,  # none: the cores are for the run
            disable_seeking=True,
            profile="flexmotion",
        )
        self._mcap = foxglove.open_mcap(file, context=context, writer_options=options)  # type: ignore[arg-type]
        self._mcap.write_metadata(SCHEMA, header.metadata())
        for name, content in attachments.items():
            self._mcap.attach(
                log_time=header.start_ns,
                create_time=header.start_ns,
                name=name,
                media_type=_MEDIA_TYPES.get(name[name.rfind(".") :], "application/octet-stream"),
                data=content,
            )
        super().__init__(context, header.joints)
        self.flush()

    def flush(self) -> None:
        """Write everything to the file, where it stays readable if this process dies."""
        self._mcap.flush()
        self.file.mark()

    def close(self) -> None:
        """Write index and statistics, and close the file."""
        self._mcap.close()
        self.file.close()
