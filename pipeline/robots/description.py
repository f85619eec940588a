"""URDF and SRDF files, read with messages that say what is wrong, and changed before pinocchio sees them.

Pinocchio's own parser prints to the console or reads on where a file is malformed: the tree of links is checked here.
"""

import math
import sysconfig
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import RobotError, shown, unknown
from pipeline.robots.xml import check_mesh, read_xml

SHARE = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix" / "share"  # where example-robot-data keeps its robots
OWN = Path(__file__).parent / "descriptions"  # package://descriptions: the robots written here
VIRTUAL = ("x", "y", "z", "yaw", "pitch", "roll")  # of a floating base, in this order from the world
_DIRECTIONS = ("1 0 0", "0 1 0", "0 0 1", "0 0 1", "0 1 0", "1 0 0")
_SHAPES = {"box": {"size": 3}, "cylinder": {"radius": 1, "length": 1}, "sphere": {"radius": 1}, "mesh": {}}
_TRIPLES = ("xyz", "rpy", "scale")
# Of links from the root on. Pinocchio and urdfdom call themselves for each: with the usual stack they crash the
# interpreter somewhere between 2000 and 5000.
_LONGEST = 500
# Of what urdfdom reads besides; where these are no numbers it leaves the element out and says so on the console only.
_NUMERIC = {
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    "mimic": ("multiplier", "offset"),
    "dynamics": ("damping", "friction"),
    "calibration": ("rising", "falling"),
    "safety_controller": ("soft_lower_limit", "soft_upper_limit", "k_position", "k_velocity"),
}
_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")


@dataclass(frozen=True)
class Movable:
    """A fixed joint of a description that moves after all.

    Attributes:
        name: the joint's name from then on.
        axis: of the rotation, in the joint's frame (3,).
        lower, upper: limits [rad].
        velocity: limit [rad/s].
        xyz: another origin in the parent link's frame [m]; None keeps the file's.
    """

    name: str
    axis: tuple[float, ...]
    lower: float
    upper: float
    velocity: float = 1.0
    xyz: tuple[float, ...] | None = None


def resolve(uri: str, package_dirs: Sequence[str | Path], beside: Path | None = None) -> Path:
    """Return the file of a path or `package://` address.

    Args:
        uri: an absolute path, a path relative to `beside` (or the working directory), or `package://name/rest`.
        package_dirs: folders that hold packages, searched before example-robot-data's and ours.
        beside: folder of the file that names it; its parents are searched for packages as well.

    Raises:
        RobotError: no such file; names where it was looked for.
    """
    if uri.startswith("package://"):
        inside = uri.removeprefix("package://")
        folders = [Path(folder) for folder in package_dirs] + (list(beside.parents) if beside else [])
        folders += [SHARE, OWN.parent]
        candidates = [folder / inside for folder in folders]
    else:
        path = Path(uri.removeprefix("file://"))
        candidates = [path if path.is_absolute() or beside is None else beside / path]
    for candidate in candidates:
        if is_file(candidate):
            return candidate.resolve()
    places = ", ".join(dict.fromkeys(str(candidate) for candidate in candidates))
    raise RobotError(f"there is no file {uri!r}; looked for {places}")


def is_file(path: Path) -> bool:
    """Tell whether there is such a file; a name no file can have is none."""
    try:
        return path.is_file()
    except OSError:
        return False


def read_urdf(path: Path, package_dirs: Sequence[str | Path] = ()) -> ET.Element:
    """Return the <robot> element of a URDF, its tree of links checked and its meshes given by absolute paths.

    Raises:
        RobotError: no XML, no robot, a link or joint that is missing or named twice, no tree, a number that is none,
            or a mesh that does not exist.
    """
    root = _parse(path, "URDF")
    links = _names(root, "link", path)
    joints = _names(root, "joint", path)
    if not links:
        raise RobotError(f"{path} has no links")
    if not root.get("name"):
        raise RobotError(f"the <robot> of {path} has no name")
    parents: dict[str, str] = {}
    for name, joint in joints.items():
        ends = []
        for role in ("parent", "child"):
            element = joint.find(role)
            link = element.get("link") if element is not None else None
            if link not in links:
                raise RobotError(unknown(f"joint {name!r} of {path} has as {role} link", str(link), links))
            ends.append(link)
        if ends[1] in parents:
            raise RobotError(f"link {ends[1]!r} of {path} is the child of two joints")
        parents[ends[1]] = ends[0]
        if joint.get("type") not in _TYPES:
            raise RobotError(unknown(f"joint {name!r} of {path} has type", str(joint.get("type")), _TYPES))
        _limits(name, joint, path)
    roots = [link for link in links if link not in parents]
    if len(roots) != 1:
        raise RobotError(f"{path} has {len(roots)} root links ({', '.join(roots) or 'its joints form a loop'})")
    for link in links:  # one root, but what hangs on a loop never reaches it
        seen = {link}
        while link in parents:
            link = parents[link]
            if link in seen:
                raise RobotError(f"the joints of {path} form a loop through link {link!r}")
            seen.add(link)
            if len(seen) > _LONGEST:
                raise RobotError(
                    f"{path} has more than {_LONGEST} links one after the other; at most {_LONGEST} are read"
                )
    for element in root.iter():
        for key in (*_TRIPLES, "size", "radius", "length"):
            if key in element.attrib and len(numbers(element, key, path)) != 3 and key in _TRIPLES:
                raise RobotError(
                    f"{path} has {key}={shown(element.get(key))} in a <{element.tag}>; it must be 3 numbers"
                )
        for key in _NUMERIC.get(element.tag, ()):
            if key in element.attrib and len(numbers(element, key, path)) != 1:
                raise RobotError(
                    f"{path} has {key}={shown(element.get(key))} in a <{element.tag}>; it must be a number"
                )
    for link, element in links.items():
        for collision in element.findall("collision"):
            shapes = list(collision.findall("geometry/*"))
            if len(shapes) != 1 or shapes[0].tag not in _SHAPES:
                found = ", ".join(f"<{shape.tag}>" for shape in shapes) or "nothing"
                raise RobotError(
                    f"a <collision> of link {link!r} of {path} holds {found}; it must be one of {', '.join(_SHAPES)}"
                )
            _check_shape(shapes[0], link, path)
        for mass in element.findall("inertial/mass"):
            if numbers(mass, "value", path)[0] < 0:
                raise RobotError(f"link {link!r} of {path} has mass {mass.get('value')} kg; it must not be negative")
    for mesh in root.iterfind("./link/collision/geometry/mesh"):
        if "filename" not in mesh.attrib:
            raise RobotError(f"a <mesh> of {path} has no filename")
        file = resolve(mesh.attrib["filename"], package_dirs, path.parent)
        check_mesh(file)
        mesh.set("filename", str(file))
    return root


def make_movable(root: ET.Element, joint: str, movable: Movable) -> None:
    """Turn a fixed joint of a description into a revolute one.

    Raises:
        RobotError: no such joint, or one that moves already.
    """
    joints = {str(element.get("name")): element for element in root.findall("joint")}
    if joint not in joints:
        raise RobotError(unknown("movable names a joint that does not exist:", joint, joints))
    element = joints[joint]
    if element.get("type") != "fixed":
        raise RobotError(f"movable names joint {joint!r}, which is {element.get('type')} already")
    if movable.name != joint and movable.name in joints:
        raise RobotError(f"movable renames joint {joint!r} to {movable.name!r}, which is another joint")
    if len(movable.axis) != 3 or not any(movable.axis) or not movable.lower < movable.upper:
        raise RobotError(
            f"movable {joint!r} needs an axis of three numbers, not all 0, and lower below upper: {movable}"
        )
    for tag in ("axis", "limit", "mimic", "safety_controller"):
        for old in element.findall(tag):
            element.remove(old)
    element.set("name", movable.name)
    element.set("type", "revolute")
    ET.SubElement(element, "axis", xyz=_text(movable.axis))
    limit = {"lower": movable.lower, "upper": movable.upper, "velocity": movable.velocity, "effort": 0.0}
    ET.SubElement(element, "limit", {key: repr(float(value)) for key, value in limit.items()})
    if movable.xyz is not None:
        origin = element.find("origin")
        if origin is None:
            origin = ET.SubElement(element, "origin")
        origin.set("xyz", _text(movable.xyz))


def float_base(root: ET.Element, bounds: Mapping[str, Sequence[float]]) -> tuple[str, ...]:
    """Put six virtual joints, base_x to base_roll, between the world and the root link.

    Returns the names of those that turn without end: angles whose bounds are a turn or more apart.

    Args:
        root: the <robot> element.
        bounds: lower and upper limit of each of `VIRTUAL` [m, rad].

    Raises:
        RobotError: bounds for other names than `VIRTUAL`.
    """
    if set(bounds) != set(VIRTUAL):
        raise RobotError(f"floating has bounds for {', '.join(bounds)}; it needs {', '.join(VIRTUAL)}")
    children = {element.get("link") for element in root.findall("./joint/child")}
    link = next(str(element.get("name")) for element in root.findall("link") if element.get("name") not in children)
    before = "base_world"
    ET.SubElement(root, "link", name=before)
    for name, direction in zip(VIRTUAL, _DIRECTIONS, strict=True):
        kind = "prismatic" if name in "xyz" else "revolute"
        joint = ET.SubElement(root, "joint", name=f"base_{name}", type=kind)
        after = link if name == VIRTUAL[-1] else f"base_after_{name}"
        if after != link:
            ET.SubElement(root, "link", name=after)
        ET.SubElement(joint, "parent", link=before)
        ET.SubElement(joint, "child", link=after)
        ET.SubElement(joint, "axis", xyz=direction)
        if len(bounds[name]) != 2 or not -math.inf < bounds[name][0] < bounds[name][1] < math.inf:
            raise RobotError(f"floating.{name} is {list(bounds[name])}; it must be a lower and an upper limit, finite")
        lower, upper = (repr(float(bound)) for bound in bounds[name])
        ET.SubElement(joint, "limit", lower=lower, upper=upper, velocity="1.0", effort="0.0")
        before = after
    return tuple(f"base_{name}" for name in VIRTUAL[3:] if bounds[name][1] - bounds[name][0] >= 2 * math.pi)


def bound_continuous(root: ET.Element, bound: float) -> tuple[str, ...]:
    """Make continuous joints revolute, with limits of -bound and bound [rad]: pinocchio has them as points of a circle.

    Returns the names of these joints.
    """
    names = []
    for joint in root.findall("joint"):
        if joint.get("type") != "continuous":
            continue
        names.append(str(joint.get("name")))
        joint.set("type", "revolute")
        limit = joint.find("limit")
        if limit is None:
            limit = ET.SubElement(joint, "limit", effort="0.0", velocity="1.0")
        limit.set("lower", repr(-bound))
        limit.set("upper", repr(bound))
    return tuple(names)


@dataclass(frozen=True)
class Semantics:
    """What an SRDF says.

    Attributes:
        disabled: pairs of link names that are not checked against each other.
        states: joint values by the name of the state [rad or m].
    """

    disabled: tuple[tuple[str, str], ...] = ()
    states: dict[str, dict[str, float]] | None = None


def read_srdf(path: Path) -> Semantics:
    """Return disabled pairs and named states of an SRDF. States that share a name are joined.

    Raises:
        RobotError: no XML, a URDF, or a value that is not a number.
    """
    root = _parse(path, "SRDF")
    if root.find("link") is not None:
        raise RobotError(f"{path} is no SRDF: it describes links, as a URDF does")
    pairs = [(str(e.get("link1")), str(e.get("link2"))) for e in root.iter("disable_collisions")]
    states: dict[str, dict[str, float]] = {}
    for state in root.iter("group_state"):
        values = states.setdefault(str(state.get("name")), {})
        for joint in state.findall("joint"):
            values[str(joint.get("name"))] = numbers(joint, "value", path)[0]
    return Semantics(tuple(pairs), states)


def _parse(path: Path, what: str) -> ET.Element:
    root = read_xml(path)
    if root.tag != "robot":
        raise RobotError(f"{path} is no {what}: its outermost element is <{root.tag}>, not <robot>")
    return root


def _names(root: ET.Element, tag: str, path: Path) -> dict[str, ET.Element]:
    found: dict[str, ET.Element] = {}
    for element in root.findall(tag):
        name = element.get("name")
        if not name:
            raise RobotError(f"a <{tag}> of {path} has no name")
        if name in found:
            raise RobotError(f"{path} has two of <{tag} name={name!r}>")
        found[name] = element
    return found


def _check_shape(shape: ET.Element, link: str, path: Path) -> None:
    """Refuse a shape without its sizes: urdfdom leaves such a body out and says so on the console only."""
    for key, count in _SHAPES[shape.tag].items():
        if key not in shape.attrib:
            raise RobotError(f"a <{shape.tag}> of link {link!r} of {path} has no {key}")
        values = numbers(shape, key, path)
        if len(values) != count or min(values) <= 0:
            raise RobotError(
                f"a <{shape.tag}> of link {link!r} of {path} has {key}={shape.get(key)!r}; it must be {count} above 0"
            )


def _limits(name: str, joint: ET.Element, path: Path) -> None:
    """Refuse limits that are missing, crossed or no numbers: urdfdom says so on the console only."""
    limit = joint.find("limit")
    if limit is None:
        if joint.get("type") in ("revolute", "prismatic") and joint.find("mimic") is None:
            raise RobotError(f"joint {name!r} of {path} is {joint.get('type')} and has no <limit>")
        return
    for key in ("effort", "velocity"):
        if key not in limit.attrib:
            raise RobotError(f"the <limit> of joint {name!r} of {path} has no {key}")
    found = {key: numbers(limit, key, path) for key in ("lower", "upper", "velocity", "effort") if key in limit.attrib}
    for key, values in found.items():
        if len(values) != 1:
            raise RobotError(
                f"the <limit> of joint {name!r} of {path} has {key}={limit.get(key)!r}; it must be a number"
            )
    lower, upper, velocity = (found.get(key, [0.0])[0] for key in ("lower", "upper", "velocity"))
    if velocity < 0:
        raise RobotError(f"joint {name!r} of {path} has velocity limit {velocity}; it must not be negative")
    if lower > upper:
        raise RobotError(f"joint {name!r} of {path} has lower limit {lower} above its upper limit {upper}")


def numbers(element: ET.Element, key: str, path: Path) -> list[float]:
    """Return the numbers of an attribute.

    Raises:
        RobotError: it holds none, or something else.
    """
    text = element.get(key, "")
    try:
        values = [float(part) for part in text.split()]
    except ValueError:
        values = []
    if not values or not all(math.isfinite(value) for value in values):
        raise RobotError(f"{path} has {key}={shown(text)} in a <{element.tag}>; it must be finite numbers")
    return values


def _text(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
