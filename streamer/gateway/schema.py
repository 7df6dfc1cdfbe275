"""The JSON Schema of the messages.

python -m flexmotion.streamer.gateway.schema docs/messages.schema.json
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from pydantic import TypeAdapter

from flexmotion.streamer.gateway.message_base import VERSION
from flexmotion.streamer.gateway.messages import Answer, Message


def schema_text() -> str:
    """The schema of all messages and of their answer, as JSON text."""
    schema = TypeAdapter(Message | Answer).json_schema()
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"FlexMotion messages, version {VERSION}",
        "description": "One JSON object a message: what a program asks a run, and the answer that each message gets.",
    }
    return json.dumps(head | schema, indent=2) + "\n"


if __name__ == "__main__":
    if len(sys.argv) == 2:
        Path(sys.argv[1]).write_text(schema_text(), encoding="utf-8")
    else:
        sys.stdout.write(schema_text())
