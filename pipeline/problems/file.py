"""Problem files: what a user writes to have one problem planned."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pipeline.errors import ConfigError, ProblemError, require, unknown
from pipeline.files import check_ordinary
from pipeline.problems.document import merged, read_yaml
from pipeline.problems.parts import PARTS, Part
from pipeline.problems.region import Region, is_number
from pipeline.robots import Obstacle, Placement, Shape
from pipeline.schema import Choice, convert

CONF = Path(__file__).resolve().parents[2] / "conf"

_FAR = 100.0  # [m] beyond which obstacles are held to be given in another unit
_FINEST = 1e-4  # spacing of a written path [rad or m]: below it files fill the disk
_SLOWEST = 1e-3  # share of the velocity limits: below it the clock's nanoseconds run over
_MOST_GOALS = 100  # each costs inverse kinematics, and a tree to be searched from
_GROUPS = {"robot": "", "planner": "rrtconnect_arm", "sampler": "directions", "adherence": "projection_arm"}


@dataclass(frozen=True)
class Body:
    """A shape and where it is.

    Attributes:
        shape: box, sphere, cylinder, mesh or octree.
        size: full extents [m]: three numbers, or one for all; a cylinder's are diameter, diameter, length; a mesh's are
            scales, which mirror it where they are negative, an octree's the edge of a leaf.
        xyz, rpy: position [m] and orientation [rad] in the world, or in the frame of a grasp.
        name: by which `touches` speaks of it.
        file: of a mesh (STL, OBJ, DAE), or of an octree's points (N, 3) as .npy or .csv; relative to the problem file.
    """

    shape: Shape
    size: Any
    xyz: tuple[float, ...] = (0.0, 0.0, 0.0)
    rpy: tuple[float, ...] = (0.0, 0.0, 0.0)
    name: str = ""
    file: str = ""

    def obstacle(self, folder: Path) -> Obstacle:
        """Return the shape at its pose; files are found from `folder`.

        Raises:
            ProblemError: sizes that are not positive, or a file that is missing or malformed.
            ConfigError: a pose that is not finite.
        """
        size = self.size if isinstance(self.size, list | tuple) else [self.size] * 3
        mirrored = self.shape is Shape.MESH  # a negative scale mirrors the mesh
        if len(size) != 3 or not all(is_number(s) and 0 < (abs(s) if mirrored else s) < np.inf for s in size):
            what = (
                "is a scale: it must be 1 or 3 numbers other than 0" if mirrored else "must be 1 or 3 numbers above 0"
            )
            raise ProblemError(f"{self.shape.value} {self.name!r} has size {self.size}; it {what}")
        if self.shape in (Shape.MESH, Shape.OCTREE) and not self.file:
            raise ProblemError(f"{self.shape.value} {self.name!r} has no file")
        if self.file and self.shape not in (Shape.MESH, Shape.OCTREE):
            raise ProblemError(
                f"{self.shape.value} {self.name!r} has the file {self.file!r}, which only a mesh or octree has"
            )
        pose = Placement(self.xyz, self.rpy).se3()
        lengths = [*map(abs, self.xyz), *(size if self.shape is not Shape.MESH else [])]  # a mesh's size is a scale
        if max(lengths) > _FAR:
            raise ProblemError(
                f"{self.shape.value} {self.name!r} has size {self.size} at {list(self.xyz)}; lengths are metres, "
                f"at most {_FAR:g}: are these millimetres?"
            )
        x, y, z, w = (float(part) for part in pin.Quaternion(pose.rotation).coeffs())
        file = str(folder / self.file) if self.file else ""
        points = _points(Path(file)) if self.shape is Shape.OCTREE else None
        return Obstacle(
            self.shape,
            (self.xyz[0], self.xyz[1], self.xyz[2]),
            (x, y, z, w),
            (float(size[0]), float(size[1]), float(size[2])),
            self.name,
            file,
            points,
        )


@dataclass(frozen=True)
class Grasp(Body):
    """A body that a frame of the robot carries.

    Attributes:
        frame: that carries it; the tool by default.
        touches: obstacles that the body may touch: names, or names and how deep [m] (see `Validity`).
        beside: bodies of the robot that the body may touch, besides those of the joint that carries it; likewise.
        mass: of the body [kg], for the balance of the robot.
    """

    frame: str = ""
    touches: Any = ()
    beside: Any = ()
    mass: float = 0.0

    def __post_init__(self) -> None:
        require("grasp.mass", self.mass, at_least=0, unit=" kg")
        for name in ("touches", "beside"):
            self.depths(name)

    def depths(self, which: str) -> dict[str, float | None]:
        """Return whom the body may touch by `touches` or `beside`, and how deep [m]; None for the usual depth.

        Raises:
            ConfigError: neither a list of names nor a mapping of names to depths.
        """
        value = getattr(self, which)
        if isinstance(value, Mapping):
            given: dict[str, float] = convert(value, dict[str, float], f"grasp.{which}")
            for name, depth in given.items():
                require(f"grasp.{which}.{name}", depth, above=0, unit=" m")
            return dict(given)
        names: tuple[str, ...] = convert(value, tuple[str, ...], f"grasp.{which}")
        return dict.fromkeys(names)


@dataclass(frozen=True)
class ChainFile:
    """A chain of regions; see `chain`."""

    regions: tuple[Region, ...]
    frame: str = ""
    name: str = "chain"


@dataclass(frozen=True)
class Where:
    """A start or goal: exactly one of these.

    Attributes:
        configuration: of all joints, in the order in which the robot lists them [rad or m]; of a chain's robot those of
            the arm are enough.
        joints: values by name; those left out rest.
        pose: of the frame in the world; solved for by inverse kinematics.
        region: the same with any pose in it.
        values: of some joints, a chain's among them; the others are solved for as well.
        frame: for pose and region; the tool by default.
        project: move a configuration that is off the manifold onto it, instead of refusing it.
    """

    configuration: tuple[float, ...] | None = None
    joints: dict[str, float] | None = None
    pose: Placement | None = None
    region: Region | None = None
    values: dict[str, float] | None = None
    frame: str = ""
    project: bool = False

    def __post_init__(self) -> None:
        given = [n for n in ("configuration", "joints", "pose", "region", "values") if getattr(self, n) is not None]
        if len(given) != 1:
            way_out = "; on the command line an empty one is left out: +changes.goal.region=" if given else ""
            raise ConfigError(
                "a start or goal is one of configuration, joints, pose, region, values; this one has "
                f"{', '.join(given) or 'none'}{way_out}"
            )
        if self.project and not self.exact:
            raise ConfigError(
                f"project says nothing beside {given[0]}: what inverse kinematics finds is on the manifold"
            )
        if self.frame and self.pose is None and self.region is None:
            raise ConfigError(
                f"frame is {self.frame!r} beside {given[0]}: it says where a pose or region is of, nothing else"
            )
        if self.values == {} or (self.region is not None and all(self.region.region().free)):
            raise ConfigError(f"a start or goal has {given[0]} that say nothing: any configuration would do")

    @property
    def exact(self) -> bool:
        """True when it says the joints, not where a frame is."""
        return self.configuration is not None or self.joints is not None


@dataclass(frozen=True)
class ProblemFile:
    """One problem, as a file says it.

    Attributes:
        robot: name of a file in conf/robot, or the same content.
        constraints: entries of `PARTS`, each with its `kind`.
        start, goal: where from and to.
        obstacles: in the world.
        grasps: what the robot holds.
        chain: a chain of regions that the tool is held by.
        planner, sampler, adherence: names of files in conf/, or the same content.
        time_limit: of searches and shortcuts [s]; what the file says is made before, inverse kinematics included, and
            the last path is verified after it.
        margin: to obstacles, and inside what conditions bound, in planning; the check of the path has none [m].
        self_margin: between bodies of the robot, likewise [m].
        shortcuts: attempts to shorten the path.
        goals: how many configurations the pose or region of a goal, or of a start, is turned into; those of a goal are
            searched from at all turns of their angles within the limits.
        spacing: of the written path's states [rad or m].
        speed: share of the joint velocity limits.
        seed: of everything random.
    """

    robot: Any
    start: Where
    goal: Where
    constraints: tuple[dict[str, Any], ...] = ()
    obstacles: tuple[Body, ...] = ()
    grasps: tuple[Grasp, ...] = ()
    chain: ChainFile | None = None
    planner: Any = _GROUPS["planner"]
    sampler: Any = _GROUPS["sampler"]
    adherence: Any = _GROUPS["adherence"]
    time_limit: float = 10.0
    margin: float = 0.005
    self_margin: float = 0.0
    shortcuts: int = 100
    goals: int = 10
    spacing: float = 0.02
    speed: float = 1.0
    seed: int = 0
    folder: Path = field(default_factory=Path.cwd, metadata={"hidden": True})  # read_problem fills it in

    def __post_init__(self) -> None:
        require("time_limit", self.time_limit, above=0, unit=" s")
        require("margin", self.margin, at_least=0, unit=" m")
        require("self_margin", self.self_margin, at_least=0, unit=" m")
        require("shortcuts", self.shortcuts, at_least=0)
        require("goals", self.goals, at_least=1, at_most=_MOST_GOALS)
        require("spacing", self.spacing, at_least=_FINEST)
        require("speed", self.speed, at_least=_SLOWEST, at_most=1)
        require("seed", self.seed, at_least=0)
        names = [body.name for body in (*self.obstacles, *self.grasps) if body.name]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ConfigError(
                f"obstacles and grasps have {', '.join(map(repr, twice))} more than once: names tell them apart"
            )

    def parts(self) -> list[Part]:
        """Return the constraint entries, made.

        Raises:
            ConfigError: an entry without a kind, of an unknown kind, or with keys that do not fit it.
        """
        made = []
        for i, entry in enumerate(self.constraints):
            rest = dict(entry)
            kind = rest.pop("kind", None)
            if not isinstance(kind, str) or kind not in PARTS:
                raise ConfigError(unknown(f"constraints[{i}].kind is", str(kind), PARTS))
            made.append(convert(rest, PARTS[kind], f"constraints[{i}]"))
        return made


def read_problem(path: Path | str, **changes: Any) -> ProblemFile:
    """Read a problem file (YAML); keyword arguments change its entries.

    A mapping changes the entries it names and leaves the others (`goal={"region": {"x": 0.5}}`), a list or value
    replaces what is there, and None takes an entry out, as if the file left it out.

    Raises:
        ProblemError: the file is missing or no YAML, or has a key twice.
        ConfigError: a misspelt or missing key, or a value of the wrong type or out of bounds.
    """
    path = Path(path)
    content = read_yaml(path)
    if content is None:
        raise ProblemError(f"problem file {path} holds nothing; docs/problems.md says what it may say")
    if not isinstance(content, Mapping):
        raise ProblemError(f"problem file {path} holds a {type(content).__name__}; it must be a mapping")
    if "folder" in content or "folder" in changes:
        raise ConfigError("unknown key 'folder' in the problem: it is where the file is")
    named = {
        group: _content(content.get(group, default), group)
        for group, default in _GROUPS.items()
        if isinstance(changes.get(group), Mapping) and isinstance(content.get(group, default), str)
    }
    found: ProblemFile = convert(merged({**content, **named}, changes, ProblemFile), ProblemFile)
    return replace(found, folder=path.resolve().parent)


def choice(value: Any, group: str) -> Choice:
    """Return the choice a name in conf/<group> or its content stands for.

    Raises:
        ConfigError: no such file (names those there are), or content that is no choice.
    """
    made: Choice = convert(_content(value, group) if isinstance(value, str) else value, Choice, group)
    return made


def _content(name: str, group: str) -> Any:
    names = sorted(path.stem for path in (CONF / group).glob("*.yaml"))
    if name not in names:
        raise ConfigError(unknown(f"{group} is", name, names))
    return read_yaml(CONF / group / f"{name}.yaml")


def _points(path: Path) -> np.ndarray:
    try:
        check_ordinary(path)
        with warnings.catch_warnings(action="ignore"):  # numpy's of an empty file: the error below says it
            stored = (
                np.load(path, allow_pickle=False) if path.suffix == ".npy" else np.loadtxt(path, delimiter=",", ndmin=2)
            )
        points = np.array(stored.tolist(), float)  # refuses words and complex numbers
    except Exception as error:  # numpy raises half a dozen kinds for files that are no arrays
        raise ProblemError(f"points {str(path)!r} cannot be read: {' '.join(str(error).split())}") from None
    if points.ndim != 2 or points.shape[1] != 3 or not len(points) or not np.isfinite(points).all():
        raise ProblemError(f"points {str(path)!r} have shape {points.shape}; they must be finite numbers (N, 3)")
    return points
