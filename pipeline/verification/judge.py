"""The independent check of paths: nothing counts as solved until it has passed.

A path is the polyline of its states, straight in joint space. Every chord is proven: limits follow from its ends, ||F||
and conditions from their values and how much they can bend in between, and that nothing is in contact from how far
bodies move. Robot, pairs, equations and shapes are read from what the task says, by code of this room's own.
"""

import pickle
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np

from pipeline.files import stamps
from pipeline.robots.bodies import Geometry
from pipeline.robots.description import resolve
from pipeline.robots.urdf import UrdfRobot
from pipeline.spec.statement import Statement
from pipeline.verification.along import equations
from pipeline.verification.contacts import Contacts
from pipeline.verification.keeping import keeper
from pipeline.verification.kinematics import Kinematics
from pipeline.verification.pairs import (
    Item,
    items_of_obstacles,
    items_of_robot,
    pairs_of_bodies,
    pairs_of_items,
    touched,
)
from pipeline.verification.reader import read
from pipeline.verification.rows import Rows
from pipeline.verification.standing import standing_contact
from pipeline.verification.urdf import read_urdf
from pipeline.verification.verdict import CLEARANCE, Failure, Touch, Verdict, VerifierParameters

_KEPT = 8  # robots that are kept, with their meshes read
_Found = tuple[Failure, int | None, str]


@dataclass(frozen=True)
class _Robot:
    kinematics: Kinematics
    items: list[Item]
    pairs: list[tuple[int, int]]


_robots: OrderedDict[bytes, _Robot] = OrderedDict()


class Judge:
    """Checks paths of one task. Robots are kept, so that one for every scene costs little.

    Args:
        statement: the task.
        parameters: of the check; None for the usual ones.

    Raises:
        RobotError: a robot that cannot be read.
        ProblemError: an obstacle that cannot be, a body or obstacle that may touch and does not exist, or touches to a
            depth that is out of bounds or cannot be known.
    """

    def __init__(self, statement: Statement, parameters: VerifierParameters | None = None) -> None:
        self.statement, self.parameters = statement, parameters or VerifierParameters()
        robot = _robot(statement)
        self.kinematics = robot.kinematics
        self.tolerance = statement.tolerance if self.parameters.tolerance is None else self.parameters.tolerance
        self._rows = Rows(statement, robot.kinematics)
        self._keepers = [keeper(term, robot.kinematics) for term in statement.conditions]
        self._items = [*robot.items, *items_of_obstacles(statement.obstacles)]
        pairs = pairs_of_items(statement, robot.kinematics, self._items, robot.pairs)
        self._contacts = Contacts(robot.kinematics, self._items, pairs)
        beyond = standing_contact(self._items, touched(statement))
        self._standing = None if beyond is None else (Failure.COLLISION, None, beyond)

    def verify(self, path: np.ndarray, start: np.ndarray, goal: np.ndarray) -> Verdict:
        """Check that a path (T, n) leads from start to goal (n,) on the manifold, within limits and free of contact.

        A path of one state passes where start and goal are that state. A goal is the same after whole turns of joints
        that turn.
        """
        found = self._form(path, np.asarray(start, float), np.asarray(goal, float))
        if found is not None:
            return Verdict(*found, np.nan, None, np.nan, 0)
        Q = np.asarray(path, float)
        off = np.linalg.norm(self._rows.values(Q), axis=1)
        chords = len(Q) - 1
        sampled: set[int] = set()
        states = 0
        found = self._waypoints(Q, off) or self._standing
        for name in ("equations", "conditions"):
            if found is None:
                found, more = self._equations(Q) if name == "equations" else self._conditions(Q)
                sampled |= more
        if found is None:
            contacts = self._contacts.check(Q)
            sampled |= contacts.sampled
            states = len(Q) + contacts.queries
            if (contact := contacts.contact) is not None:
                what = f"{contact.first!r} is in contact with {contact.second!r}"
                if np.isfinite(contact.depth):
                    what += f", {max(contact.depth, 0.0):.3g} m deep"
                if contact.allowed:
                    what += f" (they may touch {contact.allowed:.3g} m deep)"
                found = _between(Failure.COLLISION, contact.chord, chords, f"{what}, at {_shown(contact.state)}")
        failure, segment, message = found or (None, None, "")
        deepest = self._contacts.deepest(Q) if found is None else None
        return Verdict(
            failure,
            segment,
            message,
            max_violation=float(off.max()),
            min_clearance=self._contacts.least(Q) if self.parameters.clearance else None,
            length=float(np.linalg.norm(np.diff(Q, axis=0), axis=1).sum()),
            states_checked=states,
            chords_proven=chords - len(sampled) if found is None else 0,
            chords_sampled=len(sampled) if found is None else 0,
            note=self._note(sampled, chords) if found is None else "",
            deepest=None if deepest is None else Touch(*deepest),
        )

    def _form(self, path: np.ndarray, start: np.ndarray, goal: np.ndarray) -> _Found | None:
        """Shape, finite numbers and both ends."""
        try:
            Q = np.asarray(path, float)
        except (TypeError, ValueError) as error:
            return Failure.MALFORMED, None, f"the path is no array of numbers: {error}"
        n = len(self.kinematics.names)
        if Q.size == 0:
            return Failure.EMPTY, None, "the path has no states"
        if Q.ndim != 2 or Q.shape[1] != n:
            return Failure.MALFORMED, None, f"the path has shape {Q.shape}; it must be (T, {n})"
        finite = np.isfinite(Q).all(axis=1)
        if not finite.all():
            i = int(np.argmin(finite))
            return Failure.NOT_FINITE, _segment(i, Q), f"waypoint {i} of {len(Q)} is not finite: {Q[i].tolist()}"
        bound = self.parameters.endpoint
        if not (off := float(np.linalg.norm(Q[0] - start))) <= bound:
            return Failure.WRONG_START, _segment(0, Q), f"the path begins {off:.3g} from the start; bound {bound:.3g}"
        apart = Q[-1] - goal
        apart = np.where(self.kinematics.turning, np.remainder(apart + np.pi, 2 * np.pi) - np.pi, apart)
        if not (off := float(np.linalg.norm(apart))) <= bound:
            segment = _segment(len(Q) - 1, Q)
            return Failure.WRONG_GOAL, segment, f"the path ends {off:.3g} from the goal; bound {bound:.3g}"
        return None

    def _waypoints(self, Q: np.ndarray, off: np.ndarray) -> _Found | None:
        """Limits and equations of the states (T, n)."""
        lower, upper = self.kinematics.lower, self.kinematics.upper
        outside = (lower > Q) | (upper < Q)  # (T, n)
        if outside.any():
            i, joint = divmod(int(np.argmax(outside)), Q.shape[1])
            name, low, high = self.kinematics.names[joint], lower[joint], upper[joint]
            message = f"waypoint {i}: joint {name} is {Q[i, joint]:.10g}, outside its limits [{low:.10g}, {high:.10g}]"
            return Failure.OUT_OF_BOUNDS, _segment(i, Q), message
        if not off.max() < self.tolerance:
            i = int(np.argmax(~(off < self.tolerance)))
            message = f"waypoint {i} is off the manifold: ||F|| = {off[i]:.3g}, tolerance {self.tolerance:.3g}"
            return Failure.OFF_MANIFOLD, _segment(i, Q), message
        return None

    def _equations(self, Q: np.ndarray) -> tuple[_Found | None, set[int]]:
        held = equations(self._rows.values, Q, self.tolerance)
        if held.chord is None:
            return None, held.sampled
        what = f"the chord leaves the manifold: ||F|| = {held.worst:.3g}, tolerance {self.tolerance:.3g}"
        return _between(Failure.OFF_MANIFOLD, held.chord, len(Q) - 1, what), set()

    def _conditions(self, Q: np.ndarray) -> tuple[_Found | None, set[int]]:
        sampled: set[int] = set()
        states = np.repeat(Q, 2, axis=0) if len(Q) == 1 else Q
        for kept in self._keepers:
            held = kept.held(states)
            if held.chord is not None:
                return _between(Failure.CONDITION, held.chord, len(Q) - 1, kept.message(held.worst)), set()
            sampled |= held.sampled
        return None, sampled

    def _note(self, sampled: set[int], chords: int) -> str:
        notes = []
        if sampled:
            notes.append(
                f"{len(sampled)} of {chords} chords come nearer than {CLEARANCE:g} m to contact or to another bound, "
                "and are sampled there, not proven"
            )
        surfaces = list(dict.fromkeys(item.name for item in self._items if item.form.open))
        if surfaces:
            notes.append(f"judged as a surface, in which nothing can be: {', '.join(surfaces)}")
        return "; ".join(notes)


def _robot(statement: Statement) -> _Robot:
    """Return the robot of a statement; read anew only where its settings or files changed."""
    robot = statement.robot
    files = [carried.body.file for carried in statement.carried if carried.body.file]
    if isinstance(robot, UrdfRobot):
        files += read_urdf(resolve(robot.urdf, robot.package_dirs), robot.package_dirs).files
        files += [str(resolve(robot.srdf, robot.package_dirs))] if robot.srdf else []
    key = pickle.dumps((robot, statement.chain, statement.carried, stamps(files)))
    if key not in _robots:
        kinematics = read(statement)
        kind = robot.geometry if isinstance(robot, UrdfRobot) else Geometry.PRIMITIVES
        items = items_of_robot(kinematics, kind)
        _robots[key] = _Robot(kinematics, items, pairs_of_bodies(statement, kinematics))
        if len(_robots) > _KEPT:
            _robots.popitem(last=False)
    _robots.move_to_end(key)
    return _robots[key]


def _between(failure: Failure, chord: int, chords: int, what: str) -> _Found:
    if not chords:
        return failure, None, f"at the only waypoint {what}"
    return failure, int(chord), f"between waypoints {chord} and {chord + 1} {what}"


def _segment(waypoint: int, Q: np.ndarray) -> int | None:
    """Return the segment a waypoint begins, or ends when it is the last; None in a path without segments."""
    return min(waypoint, len(Q) - 2) if len(Q) > 1 else None


def _shown(state: np.ndarray) -> list[float]:
    return [round(float(value), 4) for value in state]
