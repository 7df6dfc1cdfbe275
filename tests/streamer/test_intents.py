"""What may be asked for, and the words for it."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from configs.errors import ConfigError
from streamer.intents import FASTEST, WORDS, Clip, Intent, Stop, Text, Velocity, from_content, to_content, word_of

_WORDS = st.text(min_size=1).filter(str.strip)
_INTENTS = st.one_of(
    st.builds(Clip, _WORDS),
    st.builds(Text, _WORDS),
    st.builds(Velocity, *(st.floats(-limit, limit) for limit in FASTEST)),
    st.just(Stop()),
)


@settings(derandomize=True)
@given(_INTENTS)
def test_an_intent_comes_back_from_its_words(intent: Intent) -> None:
    assert from_content({"at": 3, **to_content(intent)}) == intent
    assert isinstance(intent, WORDS[word_of(intent)])


def test_two_at_once_are_refused() -> None:
    with pytest.raises(ConfigError, match="exactly one of: clip, text, velocity, stop; found text and stop"):
        from_content({"text": "wave", "stop": True})
