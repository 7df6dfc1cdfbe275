"""Records: rows of a fixed layout in numpy arrays, whose fields a type checker and a reader see.

A subclass of `Record` declares its layout once, as annotated class attributes. Its instances are views: they own no
data, and reading or writing a field reads or writes the array behind it. All that lies in shared memory, in a log or in
a retargeter's state is laid out this way.

    class Sample(Record):
        tick: Int = column("i8")
        q: Float = column("f8", "joints")

    class Batch(Record):
        samples: Sample = column(Sample, 5)

    dtype = Sample.dtype(joints=20)
    one = Sample(np.zeros((), dtype))      # one.q is (20,)
    many = Sample(np.zeros(1000, dtype))   # many.q is (1000, 20)
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Bool = NDArray[np.bool_]


def column(kind: str | type[Record], *shape: int | str) -> Any:
    """A field of a record.

    Args:
        kind: numpy's name of its type, such as "f8" or "S64"; or a record, whose rows the field holds.
        shape: its axes; a name is an argument of `Record.dtype`.
    """
    return _Column(kind, shape)


class _Column:
    """Reads and writes one field of a record's array."""

    def __init__(self, kind: str | type[Record], shape: tuple[int | str, ...]) -> None:
        self.kind, self.shape = kind, shape
        self.name = ""

    def __set_name__(self, owner: type[Record], name: str) -> None:
        self.name = name

    def __get__(self, record: Record | None, owner: type[Record]) -> Any:
        if record is None:
            return self
        values = record.array[self.name]
        return values if isinstance(self.kind, str) else self.kind(values)

    def __set__(self, record: Record, value: ArrayLike | Record) -> None:
        if isinstance(value, Record):
            getattr(record, self.name)[...] = value
        else:
            record.array[self.name][...] = value


class Record:
    """A view of one row, or of many, of a fixed layout.

    A field has the shape of the view followed by its own; a field without axes of a single row is a 0-d array, which
    `int()`, `float()` and `bool()` read.

    Args:
        array: structured array of `dtype(...)`, any shape, or one row of it; or the fields by name, an array each, all
            with the same leading axes (fields that are contiguous).
    """

    _columns: ClassVar[dict[str, _Column]] = {}
    _dtypes: ClassVar[dict[tuple[tuple[str, int], ...], np.dtype[np.void]]] = {}
    _floats: ClassVar[bool] = True

    def __init_subclass__(cls) -> None:
        own = {name: value for name, value in vars(cls).items() if isinstance(value, _Column)}
        cls._columns, cls._dtypes = cls._columns | own, {}
        kinds = (one.kind for one in cls._columns.values())
        cls._floats = all(kind == "f8" if isinstance(kind, str) else kind._floats for kind in kinds)

    def __init__(self, array: NDArray[Any] | np.void | Mapping[str, NDArray[Any]]) -> None:
        self.array: NDArray[Any] | Mapping[str, NDArray[Any]]
        self.array = np.asarray(array) if isinstance(array, np.void) else array

    def __setattr__(self, name: str, value: Any) -> None:
        if name != "array" and name not in self._columns:
            raise AttributeError(
                f"{type(self).__name__} has no field {name!r}, expected one of: {', '.join(self.names())}"
            )
        super().__setattr__(name, value)

    @classmethod
    def dtype(cls, **sizes: int) -> np.dtype[np.void]:
        """The layout.

        Args:
            sizes: of the axes that have names.

        Raises:
            TypeError: an axis has no size.
        """
        key = tuple(sizes.items())
        if key not in cls._dtypes:
            cls._dtypes[key] = np.dtype([(name, *_spec(one, sizes)) for name, one in cls._columns.items()])
        return cls._dtypes[key]

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """The fields, in the order of the layout."""
        return tuple(cls._columns)

    @classmethod
    def over(cls, numbers: Float, **sizes: int) -> Self:
        """A view of plain numbers, for a layout of "f8" alone.

        Args:
            numbers: (..., size of the layout in numbers), contiguous along its last axis.

        Raises:
            ValueError: the layout holds other types, or another count of numbers.
        """
        dtype = cls.dtype(**sizes)
        if not cls._floats:
            raise ValueError(f"{cls.__name__} holds other types than float64")
        if numbers.dtype != np.float64 or numbers.shape[-1] * 8 != dtype.itemsize:
            raise ValueError(
                f"{cls.__name__} takes {dtype.itemsize // 8} float64, got {numbers.shape[-1]} {numbers.dtype}"
            )
        return cls(numbers.view(dtype)[..., 0])

    def __iter__(self) -> Iterator[tuple[str, NDArray[Any]]]:
        return ((name, self.array[name]) for name in self._columns)

    def __getitem__(self, index: Any) -> Self:
        """The rows that an index selects; a slice or an integer shares the data."""
        if isinstance(self.array, np.ndarray):
            return type(self)(np.asarray(self.array[index]))
        return type(self)({name: np.asarray(value[index]) for name, value in self.array.items()})

    def __setitem__(self, index: Any, value: Self) -> None:
        """Write the rows that an index selects; the value is broadcast to them.

        Raises:
            ValueError: the value has another layout.
        """
        if isinstance(self.array, np.ndarray) and isinstance(value.array, np.ndarray):
            if self.array.dtype != value.array.dtype:
                raise ValueError(f"{type(self).__name__}: the rows have another layout")
            # As bytes: numpy copies structs element by element, ten times as slowly.
            row = np.dtype((np.void, self.array.dtype.itemsize))
            self.array.view(row)[index] = value.array.view(row)
        else:
            for name in self._columns:
                self.array[name][index] = value.array[name]

    def copy(self) -> Self:
        """The same rows in memory of their own."""
        if isinstance(self.array, np.ndarray):
            return type(self)(self.array.copy())
        return type(self)({name: value.copy() for name, value in self.array.items()})


def _spec(one: _Column, sizes: Mapping[str, int]) -> tuple[str | np.dtype[np.void], tuple[int, ...]]:
    missing = [axis for axis in one.shape if isinstance(axis, str) and axis not in sizes]
    if missing:
        raise TypeError(f"field {one.name!r}: no size is given for its axis {missing[0]!r}")
    shape = tuple(sizes[axis] if isinstance(axis, str) else axis for axis in one.shape)
    return one.kind if isinstance(one.kind, str) else one.kind.dtype(**sizes), shape
