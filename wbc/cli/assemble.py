"""``wbc assemble``: one URDF out of several."""

from __future__ import annotations

import argparse
from pathlib import Path

from lxml import etree

from wbc.errors import WbcError
from wbc.files import write_whole
from wbc.robot.assembly import assemble
from wbc.scenario.parts import load_parts


def assemble_command(arguments: argparse.Namespace) -> int:
    """Write the robot and say how large it is."""
    file, out = Path(arguments.parts), Path(arguments.out)
    name, parts = load_parts(file)
    if out.resolve() in {path.resolve() for path in (file, *(part.urdf for part in parts))}:
        raise WbcError(f"{out}: is one of the files to read; give the result another name")
    text = assemble(name, parts)
    write_whole(out, lambda stream: stream.write(text.encode("utf-8")))
    joints = [j for j in etree.fromstring(text).iterfind("joint") if j.get("type") != "fixed"]
    followers = sum(j.find("mimic") is not None for j in joints)
    coupled = f", {followers} of them coupled to others" if followers else ""
    print(f"{out}: {name}, {len(parts)} parts, {len(joints)} moving joints{coupled}")
    return 0
