"""Reading the pairs of links that an SRDF excludes from collision checking."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from wbc.robot.strict_xml import Faults, Scope, read, shown

_TAG = "disable_collisions"
_KNOWN = (_TAG, "enable_collisions", "disable_default_collisions", "group", "group_state")


def disabled_pairs(path: Path, links: Iterable[str] | None = None) -> tuple[tuple[str, str], ...]:
    """The pairs of ``<disable_collisions link1 link2>``, names sorted within a pair, no doubles.

    Args:
        path: the SRDF file.
        links: the links of the robot; a pair that names another is a fault. None: not checked.

    Raises:
        UrdfError: with all faults, one line each: ``robot.srdf:42: what, where; remedy``.
    """
    _, robot = read(Path(path), "robot")
    faults = Faults(path)
    scope = Scope(faults, "the robot")
    scope.known(robot, _KNOWN)
    valid = None if links is None else tuple(links)
    known = None if valid is None else frozenset(valid)
    pairs: dict[tuple[str, str], None] = {}
    for node in robot.every(_TAG):
        names: list[str] = []
        for end in ("link1", "link2"):
            name = scope.text(node, end, "name the link")
            if name is not None and known is not None and valid is not None and name not in known:
                what = f"unknown link '{shown(name)}'{faults.hint(name, valid)}"
                scope.fault(node, what, "name a link of the robot, or remove the line")
            elif name is not None:
                names.append(name)
        if len(names) == 2:
            first, second = sorted(names)
            if first == second:
                what = f"link '{shown(first)}' paired with itself"
                scope.fault(node, what, "name two different links, or remove the line")
            pairs.setdefault((first, second))
    faults.raise_if_any()
    return tuple(pairs)
