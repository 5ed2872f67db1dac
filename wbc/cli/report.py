"""What a run says at its end, from its summary."""

from __future__ import annotations

import math
from typing import Any


def report_lines(summary: dict[str, Any], took: float, *, balances: bool = True) -> list[str]:
    """Success or why not, then the facts a reader looks for first.

    Args:
        took: computing time of the ticks after the first, [s].
        balances: a task or phase asks for force closure; else it is named only where reached.
    """
    ticks = summary["ticks"]
    verdict = "success" if summary["success"] else f"no success: {summary['reason']}"
    lines = [f"{summary['scenario']}: {verdict}"]
    speed = f", {1e3 * took / (ticks - 1):.2f} ms per tick" if ticks > 1 else ""
    lines.append(f"  run            {summary['duration']:.3g} s in {ticks} ticks{speed}")
    rows = (
        ("phases", _phases(summary)),
        ("object error", _object(summary)),
        ("force closure", _closure(summary, balances)),
        ("forces", _forces(summary)),
        ("under torques", _torques(summary)),
        ("stack", _stack(summary)),
        ("joints", _joints(summary)),
        ("distance", _distance(summary)),
        ("gave way", _gave_way(summary)),
    )
    lines += [f"  {name:<14} {text}" for name, text in rows if text]
    return lines


def _phases(summary: dict[str, Any]) -> str:
    parts = []
    for phase in summary["phases"]:
        late = " (timed out)" if phase["name"] in summary["timeouts"] else ""
        parts.append(f"{phase['name']} from {phase['entered']:.2f} s{late}")
    return ", ".join(parts)


def _object(summary: dict[str, Any]) -> str:
    settled = summary["object_error"]["settled"]
    if settled["position"] is None:
        return ""
    whose = "of the commanded motion " if "dropped" in summary else ""
    return (
        f"{whose}at most {settled['position']:.1e} m, {settled['orientation']:.1e} rad "
        f"after {summary['object_error']['settled_after']:.2g} s"
    )


def _closure(summary: dict[str, Any], balances: bool) -> str:
    closure = summary["force_closure"]
    if closure["eps_f"] is None or not summary["object_error"]["fingers"]:
        return ""
    since = closure["below_since"]
    if since is None and not balances:
        return ""
    when = "not reached" if since is None else f"both below {closure['threshold']:.0e} "
    when += "" if since is None else f"from {since:.2f} s on"
    return f"eps_f {closure['eps_f']:.1e}, eps_m {closure['eps_m']:.1e} m² at the end; {when}"


def _torques(summary: dict[str, Any]) -> str:
    """Where the object went, contact and slip, and how near the torques came to their limits."""
    if "dropped" not in summary:
        return ""
    worst = max((x for x in summary["force_error_max_n"].values() if x is not None), default=0.0)
    parts = [
        f"object at most {1e3 * (summary['object_error_max_m'] or 0.0):.3g} mm, "
        f"{1e3 * (summary['object_error_max_rad'] or 0.0):.3g} mrad off",
        f"force error at most {worst:.2g} N",
        f"slip {1e3 * (summary['slip_max_m'] or 0.0):.2g} mm",
        f"a contact lost for {summary['contact_lost_s']:.3g} s",
    ]
    if summary["tau_max_ratio"] is not None:
        parts.append(f"torques up to {100 * summary['tau_max_ratio']:.0f} % of their limits")
    return ", ".join(parts)


def _forces(summary: dict[str, Any]) -> str:
    """How many ticks found contact forces, how hard they press, how near to a limit they come."""
    if "force_statuses" not in summary:
        return ""
    ticks, held = summary["ticks"], summary["force_infeasible_ticks"]
    parts = [f"planned in {ticks - held} of {ticks} ticks" if held else "planned in every tick"]
    for name, seen in summary["force_statuses"].items():
        if name != "solved":
            when = f"{seen['ticks']} ticks from {seen['first_t']:.2f} s on"
            parts.append(f"{name.replace('_', ' ')} in {when}")
    if summary["force_sum_normal_min_n"] is not None:
        low, high = summary["force_sum_normal_min_n"], summary["force_sum_normal_max_n"]
        parts.append(f"normal forces sum to {low:.3g} to {high:.3g} N")
    margins = (
        ("force_min_cone_margin_n", "N to a cone"),
        ("force_min_torque_margin_nm", "Nm to a torque limit"),
    )
    least = [f"{summary[k]:.2g} {what}" for k, what in margins if summary[k] is not None]
    if least:
        parts.append(f"least margins {', '.join(least)}")
    return "; ".join(parts) + f"; {summary['force_iterations_mean']:.2f} solver steps per tick"


def _stack(summary: dict[str, Any]) -> str:
    stack = summary["stack"]
    told = [
        f"{e['task']} {'in' if e['event'] == 'inserted' else 'out'} at {e['t']:.2f} s"
        for e in stack["list"][:6]
    ]
    more = ", ..." if stack["events"] > len(told) else ""
    events = "1 event" if stack["events"] == 1 else f"{stack['events']} events"
    return events + (": " + ", ".join(told) + more if told else "")


def _joints(summary: dict[str, Any]) -> str:
    motion = summary["motion"]
    if motion["max_q"] is None:
        return ""
    return (
        f"at most {math.degrees(motion['max_q']):.1f} deg ({motion['max_q_joint']}), "
        f"{motion['max_v']:.2f} rad/s ({motion['max_v_joint']}), velocity step "
        f"{summary['velocity_steps']['max']:.1e} rad/s per tick"
    )


def _distance(summary: dict[str, Any]) -> str:
    distance = summary["distance"]
    if distance["min"] is None or distance["t"] is None:
        return ""
    return f"smallest of the watched pairs {distance['min']:.3f} m at {distance['t']:.2f} s"


def _gave_way(summary: dict[str, Any]) -> str:
    """The flags raised, with the number of ticks, and the joint behind most of them."""
    flags = [
        f"{name} in {count} ticks"
        for name, count in summary["status"].items()
        if count and name != "DONE"
    ]
    joint = summary["limits"]["most_limited_joint"]
    if joint is not None:
        flags.append(f"most often at joint {joint}")
    return ", ".join(flags) or "nothing"
