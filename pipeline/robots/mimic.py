"""Joints that mimic others, directly or through further ones: they stand, or move, where their leader puts them."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import RobotError
from pipeline.robots.description import numbers

_DEFAULTS = {"multiplier": 1.0, "offset": 0.0}  # of the URDF's <mimic>


@dataclass(frozen=True)
class Follower:
    """A joint that stands at `multiplier` times its leader's value plus `offset`, whatever its own limits are.

    Attributes:
        leader: name of the joint it mimics.
        multiplier: of the leader's value.
        offset: added to it [rad or m].
    """

    leader: str
    multiplier: float
    offset: float


def take_followers(root: ET.Element, path: Path) -> dict[str, Follower]:
    """Return the moving joints that mimic others, by name, and take the <mimic> elements out of the description.

    Limits of a follower do not count, and it needs none: they are put in where they are missing, for the parsers below.

    Raises:
        RobotError: a <mimic> without a joint, with a number that is none, or in a loop (the message names it).
    """
    found = {}
    for joint in root.findall("joint"):
        mimic = joint.find("mimic")
        if mimic is None:
            continue
        joint.remove(mimic)
        name = str(joint.get("name"))
        if joint.get("type") == "fixed":
            continue
        if not mimic.get("joint"):
            raise RobotError(f"the <mimic> of joint {name!r} of {path} names no joint")
        values = [numbers(mimic, key, path) if key in mimic.attrib else [default] for key, default in _DEFAULTS.items()]
        if any(len(value) != 1 for value in values):
            raise RobotError(f"the <mimic> of joint {name!r} of {path} has {mimic.attrib}; each must be one number")
        found[name] = Follower(str(mimic.get("joint")), values[0][0], values[1][0])
        if joint.find("limit") is None:
            ET.SubElement(joint, "limit", lower="0.0", upper="0.0", velocity="1.0", effort="0.0")
    for name in found:
        loop = leaders(name, found)
        if name in loop:
            raise RobotError(f"joints of {path} mimic each other in a loop: {', '.join([name, *loop])}")
    return found


def leaders(name: str, followers: Mapping[str, Follower]) -> list[str]:
    """Return the joint that `name` mimics, the one that one mimics, and so on; ends where a loop closes."""
    found: list[str] = []
    while name in followers and name not in found[:-1]:
        name = followers[name].leader
        found.append(name)
    return found


def through(name: str, followers: Mapping[str, Follower]) -> Follower:
    """Return how a joint follows the one at the end of its leaders, which follows none."""
    own = followers[name]
    if own.leader not in followers:
        return own
    there = through(own.leader, followers)
    return Follower(there.leader, own.multiplier * there.multiplier, own.multiplier * there.offset + own.offset)


def followed(name: str, followers: Mapping[str, Follower], standing: Mapping[str, float]) -> float:
    """Return where `name` stands, from where the joints that follow none stand; joints that are not there are at 0."""
    if name not in followers:
        return standing.get(name, 0.0)
    follower = followers[name]
    return follower.multiplier * followed(follower.leader, followers, standing) + follower.offset
