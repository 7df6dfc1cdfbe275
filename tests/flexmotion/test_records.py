"""A record declares its layout once, and is a view of whatever array holds it."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.records import Float, Int, Record, column


class Sample(Record):
    """A layout with a size that is known later."""

    tick: Int = column("i8")
    q: Float = column("f8", "joints")
    feet: Float = column("f8", 2, 4)


class Numbers(Record):
    """A layout of numbers alone."""

    com: Float = column("f8", 2)
    landed: Float = column("f8")


class Path(Record):
    """A layout that holds rows of another."""

    start: Float = column("f8")
    points: Numbers = column(Numbers, "points")


def test_a_field_has_the_shape_of_the_view_and_then_its_own() -> None:
    dtype = Sample.dtype(joints=3)
    assert dtype.names == Sample.names() == ("tick", "q", "feet")
    one, many = Sample(np.zeros((), dtype)), Sample(np.zeros(5, dtype))
    assert (one.tick.shape, one.q.shape, one.feet.shape) == ((), (3,), (2, 4))
    assert (many.tick.shape, many.q.shape, many.feet.shape) == ((5,), (5, 3), (5, 2, 4))


def test_writing_a_field_writes_the_array_behind_it() -> None:
    rows = np.zeros(4, Sample.dtype(joints=2))
    view = Sample(rows)
    view.q = 1.5
    view[2].tick = 7
    view[1:3].feet[:, 0, 0] = 2.0
    assert (rows["q"] == 1.5).all()
    assert rows["tick"].tolist() == [0, 0, 7, 0]
    assert rows["feet"][:, 0, 0].tolist() == [0.0, 2.0, 2.0, 0.0]


def test_a_copy_no_longer_follows() -> None:
    rows = np.zeros((), Sample.dtype(joints=2))
    copy = Sample(rows).copy()
    rows["tick"] = 3
    assert int(copy.tick) == 0


def test_fields_may_lie_apart() -> None:
    fields = {"tick": np.zeros(4, np.int64), "q": np.zeros((4, 2)), "feet": np.zeros((4, 2, 4))}
    view = Sample(fields)
    view[1:].q = 2.0
    assert fields["q"][:, 0].tolist() == [0.0, 2.0, 2.0, 2.0]
    assert [name for name, _ in view] == ["tick", "q", "feet"]


def test_numbers_are_seen_as_a_record_and_stay_where_they_are() -> None:
    states = np.arange(12.0).reshape(4, 3)
    view = Numbers.over(states)
    assert view.com.tolist() == states[:, :2].tolist()
    view.landed = -1.0
    assert (states[:, 2] == -1.0).all()
    assert float(Numbers.over(states[1]).landed) == -1.0


def test_numbers_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match="takes 3 float64, got 4"):
        Numbers.over(np.zeros(4))
    with pytest.raises(ValueError, match="other types than float64"):
        Sample.over(np.zeros(12), joints=2)


def test_a_name_without_a_size_is_an_error() -> None:
    with pytest.raises(TypeError, match="joints"):
        Sample.dtype()


def test_a_record_may_hold_rows_of_another() -> None:
    states = np.arange(14.0).reshape(2, 7)
    view = Path.over(states, points=2)
    assert view.points.com.shape == (2, 2, 2)
    assert view[1].points[0].com.tolist() == [8.0, 9.0]
    view[0].points.landed = -1.0
    assert states[0].tolist() == [0.0, 1.0, 2.0, -1.0, 4.0, 5.0, -1.0]
    view.points = view[0].points.copy()
    np.testing.assert_array_equal(states[1, 1:], states[0, 1:])
    assert states[1, 0] == 7.0


def test_rows_that_an_index_selects_are_written() -> None:
    rows, other = np.zeros((3, 3)), np.arange(3.0)
    Numbers.over(rows)[np.array([True, False, True])] = Numbers.over(other)
    assert rows.tolist() == [[0.0, 1.0, 2.0], [0.0, 0.0, 0.0], [0.0, 1.0, 2.0]]
    apart = Numbers({"com": np.zeros((3, 2)), "landed": np.zeros(3)})
    apart[1:] = Numbers.over(other)
    assert apart.com.tolist() == [[0.0, 0.0], [0.0, 1.0], [0.0, 1.0]]
    assert apart.landed.tolist() == [0.0, 2.0, 2.0]
    with pytest.raises(ValueError, match="Sample: the rows have another layout"):
        Sample(np.zeros(2, Sample.dtype(joints=2)))[:1] = Sample(np.zeros(1, Sample.dtype(joints=3)))


def test_numbers_within_numbers_must_be_numbers_too() -> None:
    class Outer(Record):
        sample: Sample = column(Sample)

    with pytest.raises(ValueError, match="other types than float64"):
        Outer.over(np.zeros(12), joints=2)


def test_a_row_that_was_read_by_itself_is_a_record_too() -> None:
    # Went wrong: rows of a ring are numpy's void scalars, whose copy failed.
    rows = np.zeros(2, Numbers.dtype())
    row = Numbers(rows[1])
    row.landed[...] = 3.0
    assert rows["landed"].tolist() == [0.0, 3.0] and float(row.copy().landed) == 3.0


def test_a_field_that_is_misspelt_is_an_error() -> None:
    with pytest.raises(AttributeError, match="has no field 'lande', expected one of: com, landed"):
        Numbers(np.zeros((), Numbers.dtype())).lande = 1.0  # type: ignore[attr-defined]
