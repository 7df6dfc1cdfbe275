"""`Undo`: puts objects back to how they were, where what was begun with them is given up."""

from __future__ import annotations


class Undo:
    """The attributes of some objects, as they are now; calling it brings them back.

    It is for objects whose values are replaced, and whose lists get and lose items, while the values and items
    themselves are not changed.
    """

    def __init__(self, *objects: object) -> None:
        self._kept = [
            (one, {name: list(value) if isinstance(value, list) else value for name, value in vars(one).items()})
            for one in objects
        ]

    def __call__(self) -> None:
        """Bring the attributes back."""
        for one, attributes in self._kept:
            vars(one).update(attributes)
