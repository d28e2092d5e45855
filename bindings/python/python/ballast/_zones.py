"""Zones of the tamped sleepers of a case."""

from __future__ import annotations

import ballast


def tamped_sleepers(case: ballast.Case) -> set[str]:
    """Returns the names of the tamped sleepers of a case."""
    values = case.to_dict()
    row, single = values.get("sleepers") or {}, values.get("sleeper") or []
    return {f"sleeper_{number}" for number in row.get("tamped", [])} | {s["name"] for s in single if s.get("tamped")}


def is_under(zone: str, sleepers: set[str]) -> bool:
    """Returns whether a zone is below one of these sleepers, up to its underside before the lift."""
    place, _, rest = zone.partition("/")
    return place == "under" and rest.split("/")[0] in sleepers
