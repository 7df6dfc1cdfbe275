"""CDR messages against our own decoder and one of another's making."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap_ros2._dynamic import generate_dynamic

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.log.cdr import (
    ENCAPSULATION,
    Column,
    columns_of,
    decode,
    encode,
    parse_schema,
    row_dtype,
    schema_text,
)

ELEMENTS = {
    "bool": st.booleans(),
    "int64": st.integers(-(2**63), 2**63 - 1),
    "float32": st.floats(width=32, allow_nan=False),
    "float64": st.floats(allow_nan=False),
}


@st.composite
def messages(draw: st.DrawFn) -> tuple[list[Column], dict[str, Any]]:
    columns, values = [], {}
    for index in range(draw(st.integers(1, 8))):
        kind = draw(st.sampled_from(sorted(ELEMENTS)))
        size = draw(st.sampled_from([1, 2, 5, None]))
        count = draw(st.integers(0, 4)) if size is None else size
        columns.append(Column(f"field_{index}", kind, size))
        found = draw(st.lists(ELEMENTS[kind], min_size=count, max_size=count))
        values[f"field_{index}"] = found[0] if size == 1 else found
    return columns, values


@settings(max_examples=150)
@given(messages())
def test_what_is_encoded_is_decoded_by_us_and_by_others(message: tuple[list[Column], dict[str, Any]]) -> None:
    columns, values = message
    data = encode(columns, values)
    read_back = parse_schema(schema_text(columns))
    assert read_back == columns
    ours = decode(read_back, data)
    name = "flexmotion/msg/Test"
    theirs = generate_dynamic(name, schema_text(columns))[name](data)
    for key, value in values.items():
        assert np.array_equal(ours[key], value)
        assert np.array_equal(getattr(theirs, key), value)


def test_a_row_is_its_own_message() -> None:
    dtype = TickRow.dtype(joints=3)
    row = np.zeros((), dtype)
    rng = np.random.default_rng(0)
    for name in dtype.names or ():
        row[name] = (
            rng.integers(0, 2, dtype[name].shape)
            if dtype[name].base.kind == "b"
            else rng.normal(size=dtype[name].shape)
        )
    columns = columns_of(dtype, {"q": "rad"})
    assert row_dtype(columns).itemsize == dtype.itemsize
    message = ENCAPSULATION + row.tobytes()
    assert message == encode(columns, {name: row[name] for name in dtype.names or ()})
    assert "float64[3] q  # [rad]" in schema_text(columns)


def test_a_row_with_gaps_is_refused() -> None:
    with pytest.raises(ConfigError, match="field q begins at byte 1, expected wider fields first"):
        columns_of(np.dtype([("ready", "?"), ("q", "f8")]), {})


def test_a_message_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match="q has 2 elements, expected 3"):
        encode([Column("q", "float64", 3)], {"q": [1.0, 2.0]})
    with pytest.raises(ValueError, match="buffer is smaller"):
        decode([Column("q", "float64", 3)], encode([Column("q", "float64", 2)], {"q": [1.0, 2.0]}))


def test_constants_are_no_fields_and_other_kinds_are_refused() -> None:
    column = Column("state", "int64", constants=(("OFF", 0), ("READY", 1)))
    assert "int64 READY=1\nint64 state\n" in schema_text([column])
    assert parse_schema(schema_text([column])) == [Column("state", "int64")]
    with pytest.raises(ConfigError, match="cannot read 'string name', expected a field of bool, int64"):
        parse_schema("string name\n")
