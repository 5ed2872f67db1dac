"""``wbc list``, ``wbc schema`` and ``wbc --version``."""

from __future__ import annotations

import argparse
import json
import platform
from importlib import metadata

from wbc import resources
from wbc.errors import WbcError


def list_command(arguments: argparse.Namespace) -> int:
    """Scenarios and robots that travel with the package, one line each."""
    from wbc.robot.model import load_robot
    from wbc.scenario import load

    scenarios, robots = resources.names("tasks"), resources.names("urdf")
    width = max(len(name) for name in (*scenarios, *robots, ""))
    print("scenarios")
    for name in scenarios:
        try:
            about = load(resources.find("tasks", name)).scenario.description
        except WbcError as error:
            about = f"broken: {str(error).splitlines()[0]}"
        print(f"  {name:<{width}}  {about}".rstrip())
    print("robots")
    for name in robots:
        try:
            model = load_robot(resources.find("urdf", name))
            about = f"{model.nv} joints, {'moves in the plane' if model.planar else 'in space'}"
        except WbcError as error:
            about = f"broken: {str(error).splitlines()[0]}"
        print(f"  {name:<{width}}  {about}")
    return 0


def schema_command(arguments: argparse.Namespace) -> int:
    """The JSON Schema of scenario files."""
    from wbc.scenario import json_schema

    print(json.dumps(json_schema(), indent=2))
    return 0


def version_text() -> str:
    """Versions of wbc, pin and Python in one line."""
    try:
        own = metadata.version("wbc")
    except metadata.PackageNotFoundError:  # a checkout on the path, not installed
        own = "(not installed)"
    import pinocchio

    return f"wbc {own}, pin {pinocchio.__version__}, Python {platform.python_version()}"
