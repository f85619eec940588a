"""XML from strangers: read as far as a robot's description goes, refused before anything recurses over the rest."""

import xml.etree.ElementTree as ET
from pathlib import Path

from pipeline.errors import RobotError

DEEPEST = 100  # elements inside each other: URDF has 6, COLLADA some 20; urdfdom refuses 900, assimp crashes at 10 000


class _Shallow(ET.TreeBuilder):
    """Builds a tree until its elements lie too deep in each other."""

    def __init__(self) -> None:
        super().__init__()
        self.depth = 0

    def start(self, tag: str, attrs: dict[str, str]) -> ET.Element:
        """Open an element."""
        self.depth += 1
        if self.depth > DEEPEST:
            raise RecursionError
        return super().start(tag, attrs)

    def end(self, tag: str) -> ET.Element:
        """Close one."""
        self.depth -= 1
        return super().end(tag)


def read_xml(path: Path) -> ET.Element:
    """Return the outermost element of an XML file.

    Raises:
        RobotError: the file cannot be read, is no XML, or has elements deeper in each other than `DEEPEST`.
    """
    parser = ET.XMLParser(target=_Shallow())
    try:
        parser.feed(path.read_bytes())
        root: ET.Element = parser.close()
    except RecursionError:
        raise RobotError(f"{path} has more than {DEEPEST} elements inside each other: it is no description") from None
    except (ET.ParseError, ValueError, LookupError) as error:
        raise RobotError(f"{path} is not XML: {error}") from None
    except OSError as error:
        raise RobotError(f"{path} cannot be read: {error.strerror}") from None
    return root


def check_mesh(path: Path) -> None:
    """Refuse a mesh that is XML (COLLADA, say) and too deep for the libraries that read it.

    Raises:
        RobotError: see `read_xml`; what is no XML is left to those libraries.
    """
    with open(path, "rb") as stream:
        begin = stream.read(100)
    if begin.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<"):
        read_xml(path)
