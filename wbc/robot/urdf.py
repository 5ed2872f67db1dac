"""Strict check of a URDF before Pinocchio sees it.

Pinocchio loads a negative mass, a zero axis or crossed limits without a word, drops a geometry
whose numbers it cannot read, and names no cause when it refuses. Here every fault is found at
once and named with its line and a remedy. What passes loads in Pinocchio 3.8 and 4.1 alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import final

from wbc.robot.strict_xml import Faults, Node, Scope, read, shown
from wbc.robot.urdf_body import check_bodies
from wbc.robot.urdf_joint import Joint, Limits, check_joint
from wbc.robot.urdf_link import Link, check_link, check_material
from wbc.robot.urdf_mimic import Coupling, couplings, narrowed

MAX_LINKS = 2000
_PARTS = ("link", "joint", "material", "transmission", "gazebo")


@final
@dataclass(frozen=True)
class Description:
    """A checked URDF.

    Attributes:
        text: what was checked.
        couplings: the joints that follow another (``<mimic>``), by name.
        limits: of the joints that lead others, by name, narrowed so that these keep theirs.
    """

    text: str
    couplings: dict[str, Coupling]
    limits: dict[str, Limits]


def check_urdf(path: Path) -> None:
    """Check the URDF at `path`.

    Raises:
        UrdfError: with all faults, one line each: ``robot.urdf:42: what, where; remedy``.
    """
    read_urdf(path)


def load_urdf_text(path: Path) -> str:
    """The text of the URDF at `path` after the check of `check_urdf`.

    Raises:
        UrdfError: with all faults, one line each.
    """
    return read_urdf(path).text


def read_urdf(path: Path, text: str | None = None) -> Description:
    """The URDF at `path` and what couples its joints, after the check of `check_urdf`.

    Args:
        text: read instead of what is in the file, which then only gives its name.

    Raises:
        UrdfError: with all faults, one line each.
    """
    text, robot = read(Path(path), "robot", text)
    faults = Faults(path)
    found, limits = _check_robot(robot, faults)
    faults.raise_if_any()
    return Description(text, found, limits)


def _check_robot(robot: Node, faults: Faults) -> tuple[dict[str, Coupling], dict[str, Limits]]:
    """Note all faults; the couplings of the joints, and the limits that these narrow."""
    scope = Scope(faults, "the robot")
    scope.text(robot, "name", "name the robot")
    scope.known(robot, _PARTS)
    version = robot.attributes.get("version", "1.0")
    if version != "1.0":
        scope.fault(robot, f'version "{shown(version)}" is not read', 'write version="1.0"')
    for child in robot.children:
        if child.tag.startswith("xacro:"):
            scope.fault(child, f"<{shown(child.tag)}> is left over", "run xacro on the file first")
    _check_materials(robot, faults)
    if len(robot.every("link")) > MAX_LINKS:
        scope.fault(robot, f"more than {MAX_LINKS} links", "this is not a robot description")
        return {}, {}
    links = [check_link(node, faults) for node in robot.every("link")]
    joints = [check_joint(node, faults) for node in robot.every("joint")]
    if not links:
        scope.fault(robot, "no <link>", "a robot has at least one link")
    _check_names(links, joints, faults)
    found = couplings(joints, faults)
    limits = narrowed(joints, found, faults)
    by_name = {link.name: link for link in links if link.name is not None}
    # A link without name would make every mention of it a fault as well.
    if len(by_name) == len(links) and _check_references(by_name, joints, faults):
        _check_tree(by_name, joints, faults)
    return found, limits


def _check_materials(robot: Node, faults: Faults) -> None:
    seen: set[str] = set()
    for node in robot.every("material"):
        name = check_material(node, Scope(faults, "the robot"), must_be_named=True)
        if name in seen:
            what = f"material '{shown(name)}' is defined twice"
            Scope(faults, "the robot").fault(node, what, "rename or remove one")
        elif name is not None:
            seen.add(name)


def _check_names(links: list[Link], joints: list[Joint], faults: Faults) -> None:
    """Names are unique among the links and among the joints, and none is Pinocchio's own."""
    for kind, parts in (("link", links), ("joint", joints)):
        lines: dict[str, int] = {}
        for part in parts:
            if part.name is None:
                continue
            label = f"{kind} '{shown(part.name)}'"
            if part.name == "universe":
                what = f"{label}: 'universe' is Pinocchio's name of the fixed world"
                faults.add(part.node.line, f"{what}; rename it")
            if part.name in lines:
                what = f"{label} is already defined on line {lines[part.name]}"
                faults.add(part.node.line, f"{what}; rename one")
            lines.setdefault(part.name, part.node.line)


def _check_references(links: dict[str, Link], joints: list[Joint], faults: Faults) -> bool:
    """Whether every joint names two existing links, so that the tree can be judged."""
    sound = True
    for joint in joints:
        for role, name, node in (
            ("parent", joint.parent, joint.parent_node),
            ("child", joint.child, joint.child_node),
        ):
            if name is not None and name not in links:
                hint = faults.hint(name, links)
                what = f"unknown {role} link '{shown(name)}'{hint}"
                Scope(faults, joint.where).fault(node, what, "name a <link> of this file")
            sound = sound and name in links
    return sound


def _check_tree(links: dict[str, Link], joints: list[Joint], faults: Faults) -> None:
    """One root, one way to every link, and bodies that dynamics can move."""
    above: dict[str, Joint] = {}
    for joint in joints:
        if joint.child is None:
            continue
        if joint.child in above:
            other = above[joint.child].where
            what = f"link '{shown(joint.child)}' has two parents, the other by {other}"
            remedy = "a URDF is a tree: cut the loop"
            Scope(faults, joint.where).fault(joint.child_node, what, remedy)
        else:
            above[joint.child] = joint
    looped = _check_loops(above, faults)
    roots = [name for name in links if name not in above]
    children: dict[str, list[Joint]] = {name: [] for name in links}
    for joint in above.values():
        if joint.parent is not None:
            children[joint.parent].append(joint)
    sizes = {root: _size(root, children) for root in roots}
    main = max(roots, key=lambda root: sizes[root], default=None)
    for root in roots:
        if root != main:
            what = f"link '{shown(root)}' is a second root beside '{shown(str(main))}'"
            remedy = "join the two by a fixed joint, or remove one"
            faults.add(links[root].node.line, f"{what}; {remedy}")
    if not looped:
        check_bodies(links, roots, joints, children, faults)


def _size(root: str, children: dict[str, list[Joint]]) -> int:
    count, open_links = 0, [root]
    while open_links:
        count += 1
        open_links.extend(j.child for j in children[open_links.pop()] if j.child is not None)
    return count


def _check_loops(above: dict[str, Joint], faults: Faults) -> bool:
    """Report every ring of joints once, at its first joint; whether there was one."""
    done: set[str] = set()
    found = False
    for start in above:
        way: dict[str, Joint] = {}
        link: str | None = start
        while link is not None and link not in done and link not in way and link in above:
            way[link] = above[link]
            link = above[link].parent
        if link is not None and link in way:
            names = list(way)
            ring = [way[name] for name in names[names.index(link) :]]
            first = min(ring, key=lambda joint: joint.node.line)
            through = ", ".join(f"'{shown(str(j.name))}'" for j in reversed(ring[:8]))
            what = (
                f"the joints {through} form a loop" if len(ring) > 1 else "joins a link to itself"
            )
            Scope(faults, first.where).fault(first.node, what, "a URDF is a tree: cut the loop")
            found = True
        done.update(way)
    return found
