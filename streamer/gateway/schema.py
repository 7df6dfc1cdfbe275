"""The JSON Schema of the messages.

python -m flexmotion.streamer.gateway.schema docs/messages.schema.json
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from pydantic import TypeAdapter

from flexmotion.streamer.gateway.message_base import VERSION
from flexmotion.streamer.gateway.messages import Answer, Ended, Message


def schema_text() -> str:
    """The schema of all messages, of their answer and of the end of a target, as JSON text."""
    schema = TypeAdapter(Message | Answer | Ended).json_schema()
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"FlexMotion messages, version {VERSION}",
        "description": "One JSON object a message: what a program asks a run, its answer, and how a target has ended.",
    }
    return json.dumps(head | schema, indent=2) + "\n"


if __name__ == "__main__":
    if len(sys.argv) == 2:
        Path(sys.argv[1]).write_text(schema_text(), encoding="utf-8")
    else:
        sys.stdout.write(schema_text())
