"""What an SRDF says, held against the URDF it is used with."""

import difflib
import logging
import xml.etree.ElementTree as ET
from functools import cache
from pathlib import Path

from pipeline.errors import RobotError
from pipeline.robots.description import Semantics

log = logging.getLogger(__name__)
_SHOWN = 5  # names of a long list in a message


def check_semantics(semantics: Semantics, srdf: Path, root: ET.Element, state: str = "") -> None:
    """Hold an SRDF against the URDF it is used with.

    SRDFs are shared: those of Talos and Solo name links that reduced models of these robots lack, and many name the
    joint of a floating base. So names that do not exist are logged once; where none exists, it is another robot's.

    Args:
        semantics: what the SRDF says.
        srdf: its file.
        root: the <robot> element of the URDF, with the names of the file.
        state: the named state that is used; empty for none.

    Raises:
        RobotError: of the links, or of the joints of the state, none exists.
    """
    named = {
        "link": [link for pair in semantics.disabled for link in pair],
        "joint": list((semantics.states or {}).get(state, ())),
    }
    for tag, names in named.items():
        there = [str(element.get("name")) for element in root.findall(tag)]
        missing = [name for name in dict.fromkeys(names) if name not in there]
        if not missing:
            continue
        listed = ", ".join(repr(name) + _hint(name, there) for name in missing[:_SHOWN])
        more = f" and {len(missing) - _SHOWN} more" if len(missing) > _SHOWN else ""
        said = f"{srdf} names {tag}s that the robot does not have: {listed}{more}"
        if len(missing) == len(set(names)):
            raise RobotError(
                f"{said}; it has none of those that are named, but {', '.join(there)}: another robot's SRDF?"
            )
        _warn_once(f"{said}; what it says of them is left out")


def _hint(name: str, there: list[str]) -> str:
    close = difflib.get_close_matches(name, there, 1)
    return f" (did you mean {close[0]!r}?)" if close else ""


@cache
def _warn_once(text: str) -> None:
    log.warning(text)
