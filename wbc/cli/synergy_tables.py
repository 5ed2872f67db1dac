"""``wbc synergy tables``: what the published tables say and imply."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from wbc.arrays import Array
from wbc.cli.synergy_arguments import DEFAULT_HAND
from wbc.cli.synergy_files import near_text
from wbc.files import write_whole
from wbc.robot.hand import Hand
from wbc.robot.self_distances import self_distances
from wbc.scenario.places import robot_file
from wbc.scenario.robots import read_robot
from wbc.synergies import Synergies, consistent_postures, derived, tables, weights_of


def tables_command(arguments: argparse.Namespace) -> int:
    """Write what follows from the published tables."""
    out, t, synergies = Path(arguments.out), tables(), Synergies.from_table()
    data = derived()
    names = (*t.names, *t.new_names)
    alpha = np.stack([weights_of(name) for name in names])
    hand = Hand.of(read_robot(robot_file(DEFAULT_HAND, Path())), synergies.joints)
    nearest = self_distances(hand, synergies.command(alpha))
    data["self_distance"] = {
        name: {"mm": round(1e3 * near.distance, 3), "links": [near.first, near.second]}
        for name, near in zip(names, nearest, strict=True)
    }
    files = {
        "tables.json": json.dumps(data, indent=1, ensure_ascii=False) + "\n",
        "postures.csv": _csv(names, np.rad2deg(synergies.posture(alpha))),
        "commanded.csv": _csv(names, np.rad2deg(synergies.command(alpha))),
        "consistent.csv": _csv(t.names, np.rad2deg(consistent_postures())),
    }
    for name, text in files.items():
        _write(out / name, text)
    print(f"sigma {', '.join(f'{share:.4f}' for share in data['sigma'])}")
    print(f"{len(data['beyond_limits'])} of {len(names)} postures leave the hand's ranges:")
    for name, joints in data["beyond_limits"].items():
        print(
            f"  {name:4}"
            + ", ".join(f"{joint} {excess:+.1f} deg" for joint, excess in joints.items())
        )
    print("nearest links of the hand as commanded:")
    for name, near in zip(names, nearest, strict=True):
        print(f"  {name:4}{near_text(near)}")
    print(f"written to {out}: {', '.join(files)}")
    return 0


def _csv(names: tuple[str, ...], postures: Array) -> str:
    lines = ["# unit: deg", ",".join(("posture", *tables().joints))]
    lines += [
        ",".join((name, *(f"{value:.4f}" for value in row)))
        for name, row in zip(names, postures, strict=True)
    ]
    return "\n".join(lines) + "\n"


def _write(path: Path, text: str) -> None:
    write_whole(path, lambda file: file.write(text.encode("utf-8")))
