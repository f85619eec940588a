"""URDF files as a tree of links and joints; read without pinocchio, which planning reads them with.

Only what is well formed comes here: planning reads the same files first and says what is wrong with others.
"""

import xml.etree.ElementTree as ET
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import coal
import numpy as np

from pipeline.errors import RobotError, unknown
from pipeline.files import Stamp, stamps, unchanged
from pipeline.robots.description import Movable, resolve
from pipeline.verification.kinematics import Place

_KEPT = 16  # descriptions
_MOVING = ("revolute", "continuous", "prismatic")  # with one variable


@dataclass(frozen=True)
class Mimic:
    """A joint stands at `multiplier` times another one's value plus `offset`."""

    leader: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class UrdfJoint:
    """A joint of the file.

    Attributes:
        name: of the joint.
        kind: revolute, continuous, prismatic, fixed, floating or planar.
        parent, child: links.
        origin: in the parent link's frame; the child link's frame is there while the joint is at 0.
        axis: unit vector in the child link's frame (3,).
        lower, upper: limits [rad or m]; of a continuous joint none.
        mimic: what it follows; None where it follows nothing.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Place
    axis: np.ndarray
    lower: float
    upper: float
    mimic: Mimic | None = None

    @property
    def moves(self) -> bool:
        """Whether it has one variable."""
        return self.kind in _MOVING


@dataclass(frozen=True)
class UrdfLink:
    """A link of the file.

    Attributes:
        bodies: name, pose in the link's frame, and shape of every collision body.
        mass: [kg].
        centre: of the mass, in the link's frame (3,) [m].
    """

    bodies: tuple[tuple[str, Place, coal.CollisionGeometry], ...]
    mass: float
    centre: np.ndarray


@dataclass(frozen=True)
class Urdf:
    """A description: its links by name, its joints by name, the link that is no joint's child, and files it is in."""

    links: dict[str, UrdfLink]
    joints: dict[str, UrdfJoint]
    root: str
    files: tuple[str, ...] = ()

    def movable(self, asked: dict[str, Movable]) -> "Urdf":
        """Return the description with fixed joints that move after all.

        Raises:
            RobotError: no such joint.
        """
        joints = dict(self.joints)
        for name, movable in asked.items():
            if name not in joints:
                raise RobotError(unknown("movable names a joint that does not exist:", name, joints))
            old = joints.pop(name)
            origin = old.origin if movable.xyz is None else Place(old.origin.R, np.array(movable.xyz, float))
            joints[movable.name] = replace(
                old,
                name=movable.name,
                kind="revolute",
                origin=origin,
                axis=_unit(np.array(movable.axis, float)),
                lower=movable.lower,
                upper=movable.upper,
                mimic=None,
            )
        return replace(self, joints=joints)


_urdfs: OrderedDict[tuple[Path, tuple[str, ...]], tuple[Urdf, tuple[Stamp, ...]]] = OrderedDict()


def read_urdf(path: Path, package_dirs: Sequence[str]) -> Urdf:
    """Return what a file describes; as long as it and its meshes stay the same they are read once.

    Raises:
        RobotError: no XML, no tree of links, or a mesh that cannot be read.
    """
    key = path, tuple(package_dirs)
    if key not in _urdfs or not unchanged(_urdfs[key][1]):
        found = _read(path, package_dirs)
        _urdfs[key] = found, stamps(found.files)
        if len(_urdfs) > _KEPT:
            _urdfs.popitem(last=False)
    _urdfs.move_to_end(key)
    return _urdfs[key][0]


def read_states(path: Path) -> dict[str, dict[str, float]]:
    """Return the named states of an SRDF: joint values by name. States that share a name are joined."""
    found: dict[str, dict[str, float]] = {}
    for state in _root(path).iter("group_state"):
        values = {str(joint.get("name")): float(joint.get("value", "0")) for joint in state.findall("joint")}
        found.setdefault(str(state.get("name")), {}).update(values)
    return found


def _read(path: Path, package_dirs: Sequence[str]) -> Urdf:
    root = _root(path)
    links = {str(link.get("name")): _link(link, path, package_dirs) for link in root.findall("link")}
    joints = {str(joint.get("name")): _joint(joint) for joint in root.findall("joint")}
    ends = [link for link in links if link not in {joint.child for joint in joints.values()}]
    if len(ends) != 1:
        raise RobotError(f"{path} has {len(ends)} root links; it must have one")
    meshes = {_mesh_file(shape, path, package_dirs) for shape in root.iterfind("link/collision/geometry/mesh")}
    return Urdf(links, joints, ends[0], (str(path), *sorted(map(str, meshes))))


def _root(path: Path) -> ET.Element:
    try:
        return ET.parse(path).getroot()
    except ET.ParseError as error:
        raise RobotError(f"{path} is no XML: {error}") from None


def _joint(element: ET.Element) -> UrdfJoint:
    kind = str(element.get("type"))
    limit = element.find("limit")
    lower, upper = (0.0 if limit is None else float(limit.get(key, "0")) for key in ("lower", "upper"))
    mimic, followed = element.find("mimic"), None
    if mimic is not None and kind in _MOVING:
        factors = float(mimic.get("multiplier", "1")), float(mimic.get("offset", "0"))
        followed = Mimic(str(mimic.get("joint")), *factors)
    axis = element.find("axis")
    along = np.array([1.0, 0.0, 0.0]) if axis is None else _numbers(axis, "xyz", "1 0 0")
    return UrdfJoint(
        str(element.get("name")),
        kind,
        _end(element, "parent"),
        _end(element, "child"),
        _origin(element),
        _unit(along) if kind in _MOVING else along,
        -np.inf if kind == "continuous" else lower,
        np.inf if kind == "continuous" else upper,
        followed,
    )


def _link(element: ET.Element, path: Path, package_dirs: Sequence[str]) -> UrdfLink:
    name, bodies = str(element.get("name")), []
    special = {
        tag: {str(said.get("name")) for said in element.iterfind(f"collision_checking/{tag}")}
        for tag in ("capsule", "convex")
    }
    for i, collision in enumerate(element.findall("collision")):
        as_said = [tag for tag, names in special.items() if collision.get("name") in names]
        shape = _shape(collision, path, package_dirs, as_said)
        bodies.append((f"{name}_{i}", _origin(collision), shape))
    inertial = element.find("inertial")
    mass = None if inertial is None else inertial.find("mass")
    if inertial is None or mass is None:
        return UrdfLink(tuple(bodies), 0.0, np.zeros(3))
    return UrdfLink(tuple(bodies), float(mass.get("value", "0")), _origin(inertial).p)


def _shape(
    collision: ET.Element, path: Path, package_dirs: Sequence[str], as_said: Sequence[str]
) -> coal.CollisionGeometry:
    """Return the shape of a <collision>, of which `as_said` holds `capsule` or `convex` where the link says so."""
    shape = collision.find("geometry/*")
    if shape is None:
        raise RobotError(f"a <collision> of {path} has no geometry")
    if shape.tag == "box":
        return coal.Box(*_numbers(shape, "size"))
    if shape.tag == "sphere":
        return coal.Sphere(float(shape.get("radius", "")))
    if shape.tag == "cylinder":
        sizes = float(shape.get("radius", "")), float(shape.get("length", ""))
        return coal.Capsule(*sizes) if "capsule" in as_said else coal.Cylinder(*sizes)
    if shape.tag == "capsule":
        return coal.Capsule(float(shape.get("radius", "")), float(shape.get("length", "")))
    if shape.tag != "mesh":
        raise RobotError(f"a <collision> of {path} is a <{shape.tag}>; it must be a box, cylinder, sphere or mesh")
    mesh = read_mesh(_mesh_file(shape, path, package_dirs), _numbers(shape, "scale", "1 1 1"))
    if "convex" in as_said:
        mesh.buildConvexRepresentation(False)
        return mesh.convex
    return mesh


def _mesh_file(shape: ET.Element, path: Path, package_dirs: Sequence[str]) -> Path:
    return resolve(str(shape.get("filename")), package_dirs, path.parent)


def read_mesh(file: Path, scale: np.ndarray) -> coal.BVHModelBase:
    """Return the triangles of a mesh file (STL, OBJ, DAE), scaled along x, y and z (3,).

    Raises:
        RobotError: what is no mesh.
    """
    try:
        return coal.MeshLoader(coal.NODE_TYPE.BV_OBBRSS).load(str(file), np.asarray(scale, float))
    except Exception as error:  # what coal's and assimp's C++ throw has no common class
        raise RobotError(f"mesh {file} cannot be read: {str(error).strip()}") from None


def _end(joint: ET.Element, role: str) -> str:
    element = joint.find(role)
    return "" if element is None else str(element.get("link"))


def _origin(element: ET.Element) -> Place:
    origin = element.find("origin")
    if origin is None:
        return Place()
    return Place(of_angles(*_numbers(origin, "rpy", "0 0 0")), _numbers(origin, "xyz", "0 0 0"))


def of_angles(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Return Rz(yaw) Ry(pitch) Rx(roll) (3, 3)."""
    (a, b, c), (u, v, w) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    return np.array([
        [c * b, c * v * u - w * a, c * v * a + w * u],
        [w * b, w * v * u + c * a, w * v * a - c * u],
        [-v, b * u, b * a],
    ])  # fmt: skip


def _numbers(element: ET.Element, key: str, default: str = "") -> np.ndarray:
    return np.array([float(part) for part in element.get(key, default).split()])


def _unit(vector: np.ndarray) -> np.ndarray:
    return np.asarray(vector / np.linalg.norm(vector))
