"""Schemas of a log's topics."""

from __future__ import annotations

from typing import Any, get_args

import pytest

from flexmotion.streamer.log.messages import HEARD_SCHEMA
from flexmotion.streamer.motion.heard import Over, State


@pytest.mark.parametrize(("field", "words"), [("state", get_args(State)), ("over", get_args(Over))])
def test_the_schema_of_answers_names_every_word_that_is_written(field: str, words: tuple[str, ...]) -> None:
    """Answers are superseded and expire, and the schema of `/heard` knew of neither."""
    properties: Any = HEARD_SCHEMA["properties"]
    assert properties[field]["description"].rpartition(": ")[2].split(", ") == list(words)
