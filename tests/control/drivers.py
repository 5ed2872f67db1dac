"""What drivers hand over as a measurement when something is wrong with them."""

from __future__ import annotations

from typing import Any


class Broken:
    """A measurement of which one field raises when it is asked for."""

    def __init__(self, field: str, **values: Any) -> None:
        self._field, self._values = field, values

    def __getattr__(self, name: str) -> Any:
        if name == self._field:
            raise OSError("no device")
        return self._values[name]
