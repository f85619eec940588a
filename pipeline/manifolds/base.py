"""Constraint adherence: how a planner moves on a manifold it does not know.

An adherence method binds a constraint, a validity checker and its parameters. Its one contract is `traverse`
(Algorithms 2-4 of compnetx.txt). Steps are computed several at a time by one CasADi function that also tells, per
step, why the walk would stop; Python only reads the codes and asks for collisions. The result is that of the
step-by-step algorithm.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from enum import Enum
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from pipeline.constraints import Compiled, Constraint, Expressions, turns_on
from pipeline.errors import ConfigError, require
from pipeline.manifolds.chords import ChordProof
from pipeline.manifolds.deadline import Deadline
from pipeline.manifolds.displacement import Displacement
from pipeline.manifolds.polyline import brought_back, polyline, subdivided
from pipeline.manifolds.screening import Screen
from pipeline.manifolds.typical import typical_motion
from pipeline.robots import Validity

FINEST = 1e-5  # spacing of checks along a found path: below it the points of one fill the memory [rad or m]
_PIECES = 1000  # in which a step is checked: likewise
_ROWS = 64  # configurations or edges looked at between two looks at the clock
_GLANCE = 10  # Newton steps after which a random configuration is a direction only: most that converge need 3 to 6


class Stop(Enum):
    """Why a traversal ended; the values of the first group are the codes of the edge functions."""

    NONE = 0
    NOT_CONVERGED = 1  # a projection did not reach the manifold
    AWAY = 2  # the step led away from the target (d2 > d1)
    LEAP = 3  # the step was longer than lambda_1 gamma
    WANDERED = 4  # the way is longer than lambda_2 times the straight line
    STALLED = 5  # the step was shorter than epsilon (charts only)
    OUT_OF_BOUNDS = 6  # a joint limit
    FOLDED = 7  # the target's image in the chart was reached, the target was not (charts only)
    ARRIVED = 8  # within one step of the target
    LEFT_CHART = 9  # inside an edge function only: the chart is no longer valid
    COLLISION = 10
    STEP_LIMIT = 11
    NO_CHART = 12  # the atlas is full, or the Jacobian has lost rank
    REACHED = 13  # the target is the last state


@dataclass(frozen=True)
class Traversal:
    """The states reached on the way from one configuration to another.

    Attributes:
        states: (T, n), without the first configuration; empty when the first step already failed. The last row is the
            target exactly when `reached`.
        stop: why it ended.
    """

    states: np.ndarray
    stop: Stop

    @property
    def reached(self) -> bool:
        """True when the last state is the target."""
        return self.stop is Stop.REACHED


@dataclass
class Counters:
    """Machine-independent work of one plan."""

    traversals: int = 0
    projections: int = 0  # configurations brought onto the manifold by Newton iterations
    collision_checks: int = 0
    samples: int = 0
    fallback_samples: int = 0  # of these, drawn by the classical sampler because the learned one was exhausted
    nearest_queries: int = 0
    network_calls: int = 0
    charts: int = 0
    repairs: int = 0  # edges of a found path that the walk or the finer walk along it refused


@dataclass(frozen=True)
class AdherenceParameters:
    """Parameters all methods share (compnetx.txt, appendix D, where no other source is given).

    Attributes:
        step: gamma, length of a step [rad or m].
        leap: lambda_1, a step longer than this many gammas ends the walk. Above 1: a step is gamma long where the
            manifold is flat, and longer where it is not.
        wander: lambda_2, a way longer than this many straight lines ends the walk; at least 1.
        max_steps: the loop limit N. Not 50 as for projections: 50 steps of 0.05 do not cross a unit sphere.
        newton_steps: Newton steps inside a walk; from a step away it converges quadratically, so that more than this
            many means that it does not (measured on the sphere: at most 2).
        resolution: spacing of collision checks in walks, on the chords between their states [rad or m], at least a
            thousandth of a step.
        lookahead: steps computed per call of the edge function; costs memory and, past a stop, wasted steps.
        proof: prove that the chords of a found path are free, everywhere along them (see `ChordProof`). Without it they
            are looked at every `refinement`, and what lies in between can be missed.
        refinement: spacing of those looks [rad or m]; None for `resolution`.
        native: evaluate steps and projections as machine code where a C compiler is found, with the same results;
            compiling takes seconds, once for each robot, kind of constraint and parameters. None: where they were
            compiled before.
    """

    step: float = 0.05
    leap: float = 2.0
    wander: float = 2.0
    max_steps: int = 200
    newton_steps: int = 5
    resolution: float = 0.01
    lookahead: int = 8
    proof: bool = True
    refinement: float | None = None
    native: bool | None = False

    def __post_init__(self) -> None:
        for name in ("step", "leap", "wander", "resolution"):
            require(f"adherence.{name}", getattr(self, name), above=0)
        require("adherence.leap", self.leap, above=1)
        require("adherence.wander", self.wander, at_least=1)
        for name in ("max_steps", "newton_steps", "lookahead"):
            require(f"adherence.{name}", getattr(self, name), at_least=1)
        if self.refinement is not None:
            require("adherence.refinement", self.refinement, at_least=FINEST)
        require("adherence.resolution", self.resolution, at_least=FINEST)
        if not self.step / _PIECES <= self.resolution <= self.step:
            raise ConfigError(
                f"adherence.resolution is {self.resolution}; it must be at most step = {self.step}, and at least a "
                f"{_PIECES}th of it"
            )


@dataclass(frozen=True)
class Refined:
    """A path as the polyline of its states, straight in joint space between them.

    Attributes:
        states: the given states, brought onto the manifold, and those put in between, so that all chords are within
            the tolerance of it (T, n).
        invalid: index i of the first given segment (states[i], states[i + 1]) that fails; None when all hold.
    """

    states: np.ndarray
    invalid: int | None


class Bounds(NamedTuple):
    """What edge functions hold states against, as symbols.

    Attributes:
        squared: the square of the tolerance of ||F||.
        limited: which variables have limits.
        limits: their lower and upper ones, as two vectors; none where there are none.
    """

    squared: ca.SX
    limited: list[int]
    limits: list[ca.SX]

    @classmethod
    def symbols(cls, limited: np.ndarray) -> "Bounds":
        """Return symbols for a robot of whose variables these have limits (m,)."""
        limits = [ca.SX.sym(name, len(limited)) for name in ("lower", "upper") if len(limited)]
        return cls(ca.SX.sym("squared"), limited.tolist(), limits)

    def inside(self, q: ca.SX) -> ca.SX:
        """Expression: 1 when q (n,) is within the limits."""
        if not self.limits:
            return ca.SX(1)
        lower, upper = self.limits
        kept = q[self.limited]
        return ca.logic_and(ca.mmin(kept - lower) >= 0, ca.mmin(upper - kept) >= 0)


class Adherence(ABC):
    """A manifold made walkable: constraint, validity and parameters in one object. Lives in one process.

    Attributes:
        lower, upper: joint limits (n,); infinite for joints that turn.
        turns: how to measure where joints turn, None where none does: what differs by whole turns is one place.
        deadline: what takes long here looks at it, and raises `OutOfTime`; there is none unless a caller sets one.
    """

    def __init__(self, constraint: Constraint, validity: Validity, parameters: AdherenceParameters) -> None:
        if constraint.n != validity.robot.dimension:
            raise ConfigError(
                f"constraint {constraint.name!r} has {constraint.n} variables, "
                f"robot {validity.robot.name!r} has {validity.robot.dimension} joints"
            )
        self.constraint, self.validity, self.parameters = constraint, validity, parameters
        self.deadline = Deadline()
        constraint.prepare(parameters.native)
        self.lower, self.upper = validity.robot.lower, validity.robot.upper
        self.turns = turns_on(constraint, validity.robot)
        self.counters = Counters()
        # Steps on a curved manifold are not quite gamma long; longer chords than this are checked at all their points.
        self._covered_length = 1.1 * parameters.step
        pieces = int(np.ceil(parameters.step / parameters.resolution - 1e-9))
        # Halves before quarters: a chord that cuts a corner is deepest in its middle.
        self._shares = sorted((i / pieces for i in range(1, pieces)), key=lambda share: abs(share - 0.5))
        rows = list(enumerate(self._shares, start=1))  # of a chord, see `_chord`
        self._near = [row for row, share in rows if share < 0.5]  # the half at the state where it begins
        self._far = [row for row, share in rows if share >= 0.5]
        self._limited = np.flatnonzero(np.isfinite(self.lower))  # variables that do not turn
        self._proof: ChordProof | None = None
        self._look(validity)

    @property
    def dimension(self) -> int:
        """Number of configuration variables n."""
        return self.constraint.n

    def reset(self, validity: Validity | None = None) -> None:
        """Forget the last problem (counters, charts); with `validity`, move to another scene."""
        self.counters = Counters()
        self._look(self.validity if validity is None else validity)

    def counted(self) -> Counters:
        """Return a copy of the counters since the last reset."""
        now = Counters(**{f.name: getattr(self.counters, f.name) for f in fields(Counters)})
        now.collision_checks = self._checks() - self._checks_before
        return now

    def _look(self, validity: Validity) -> None:
        """Use a scene's checker, and its widened one where the robot's travel is known."""
        travel = validity.robot.travel
        self.validity = validity
        # A condition holds where it holds: no margin says so of the surroundings.
        useful = travel is not None and len(self._shares) > 0 and not validity.conditions
        self._wide = validity.widened((travel or 0.0) * self._covered_length / 2) if useful else None
        if self.parameters.proof and (self._proof is None or self._proof.validity is not validity):
            self._proof = ChordProof(validity, *self._motion)
            self._proof.prepare()
        self._checks_before = self._checks()

    def _checks(self) -> int:
        others = (self._wide, self._proof)
        return self.validity.checks + sum(other.checks for other in others if other is not None)

    @abstractmethod
    def traverse(
        self, q_from: np.ndarray, q_to: np.ndarray, max_states: int | None = None, land: bool = True
    ) -> Traversal:
        """Walk on the manifold from q_from towards q_to, both on the manifold (n,), over at most `max_states` states.

        The target does not count when the last of them is within a step of it. q_from is taken to be valid; q_to is
        checked when the walk gets there. Without `land` the walk ends within a step of q_to, which need not be on the
        manifold then and is never among the states. Where joints turn the walk goes the short way round and is
        continuous: the target it reaches may be whole turns away from q_to.
        """

    @abstractmethod
    def sample(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Return up to `count` configurations on the manifold and within bounds (m, n); collisions are not checked."""

    def sample_around(self, rng: np.random.Generator, Q: np.ndarray) -> np.ndarray:
        """Return up to a sample for each row of Q (m, n), all on the manifold: from a chart there, if there are charts.

        Without charts the whole manifold is sampled.
        """
        return self.sample(rng, len(Q))

    def directions(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Return configurations (count, n) to walk towards without landing: samples, or what would have become one.

        Where the manifold is hard to hit (few random configurations reach it within the limits) a search that waits for
        samples spends its time on them; a direction serves an extension as well.
        """
        Q = rng.uniform(*self.validity.robot.box, (count, self.dimension))
        self.counters.projections += count
        X, converged = self._projected(Q, _GLANCE)
        with np.errstate(invalid="ignore"):
            inside = converged & ((X >= self.lower) & (X <= self.upper)).all(axis=1)
        return np.where(inside[:, None], X, Q)

    def anchor(self, q: np.ndarray) -> None:
        """Tell the method that q (n,) is a start or goal; charts begin there."""

    def project(self, Q: np.ndarray) -> np.ndarray:
        """Project rows of Q (N, n) and return those that converged within bounds (m, n)."""
        self.counters.projections += len(Q)
        X, converged = self._projected(Q)
        with np.errstate(invalid="ignore"):
            inside = ((X >= self.lower) & (X <= self.upper)).all(axis=1)
        X = X[converged & inside]
        return X if self.turns is None else self.turns.canonical(X)

    def screen(self, q_from: np.ndarray, q_to: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Tell of edges, rows of q_from and q_to (m, n), whether they look free (m,), and how long they are (m,).

        Looks at points of the straight line, projected, at a fraction of the price of a walk: a `resolution` apart, or
        every sixteenth where that is farther. True promises nothing: the walk decides. On an edge long against the
        manifold's curvature the walk may pass elsewhere and be refused without need. Lengths are approximate, and
        infinite where an edge does not look free.
        """
        if self.turns is not None:
            q_to = self.turns.nearest(q_to, q_from)
        promising, lengths = np.zeros(len(q_from), bool), np.full(len(q_from), np.inf)
        for first in range(0, len(q_from), _ROWS):
            self.deadline.look()
            rows = slice(first, first + _ROWS)
            promising[rows], lengths[rows], projected = self._screen.look(q_from[rows], q_to[rows], self.validity)
            self.counters.projections += projected
        return promising, lengths

    def apart(self, differences: np.ndarray) -> np.ndarray:
        """Return how far apart configurations are of which these are the differences (..., n) [rad or m]."""
        offsets = differences if self.turns is None else self.turns.wrapped(differences)
        return np.asarray(np.linalg.norm(offsets, axis=-1))

    def free_rows(self, Q: np.ndarray) -> np.ndarray:
        """Tell which rows of Q (m, n) are free (m,): as the checker does, with an eye on the clock."""
        free = np.zeros(len(Q), bool)
        for first in range(0, len(Q), _ROWS):
            self.deadline.look()
            free[first : first + _ROWS] = self.validity.free_rows(Q[first : first + _ROWS])
        return free

    def prepare_screen(self) -> None:
        """Make what `screen` needs, which otherwise its first call does."""
        self._screen.prepare(self.validity)

    @cached_property
    def _screen(self) -> Screen:
        parameters = self.parameters
        return Screen(self.constraint, parameters.newton_steps, parameters.resolution, parameters.native)

    def refine(self, states: np.ndarray) -> Refined:
        """Make a path of states (T, n) a polyline that stays on the manifold, and prove that it is free.

        Rejects also a segment whose middle finds its way to the manifold elsewhere than between its ends, which is how
        a jump between two sheets of a manifold shows. Where joints turn the path comes out continuous, from its first
        state on: those given may be whole turns away from their neighbours.
        """
        if self.turns is not None:
            states = self.turns.unwrapped(states)
        self.counters.projections += len(states)
        self.deadline.look()
        states, converged = brought_back(self.constraint, states)
        end = len(states) if converged.all() else max(int(np.argmin(converged)), 1)  # what comes before holds or fails
        path, segments, broken = polyline(self.constraint, states[:end], self.lower, self.upper)
        if broken is None and end < len(states):
            broken = end - 1
        outside = ((path < self.lower) | (path > self.upper)).any(axis=1)
        if outside.any():
            first = max(int(np.argmax(outside)) - 1, 0)
            broken = min(int(segments[first]) if len(segments) else 0, len(states) if broken is None else broken)
        kept = len(segments) if broken is None else int(np.searchsorted(segments, broken))
        gap = self._first_gap(path[: kept + 1])
        return Refined(path, broken if gap is None else int(segments[gap]))

    def provable(self, q: np.ndarray) -> bool:
        """Tell whether a found path may begin or end at a free q (n,): always, unless paths are proven."""
        return self._proof is None or self._proof.allows(q)

    def _first_gap(self, path: np.ndarray) -> int | None:
        """Return the first chord of a path (T, n) that is not free; None when all are."""
        if len(path) < 2:
            return None
        if self._proof is not None:
            return self._proof.first_gap(path, self.deadline)
        spacing = self.parameters.refinement or self.parameters.resolution
        for i in range(len(path) - 1):
            self.deadline.look()
            if not all(self.validity.free(q) for q in subdivided(path[i : i + 2], spacing)[1:]):
                return i
        return None

    @cached_property
    def _motion(self) -> tuple[Displacement, np.ndarray, int]:
        """What `typical_motion` returns, made once for all scenes."""
        parameters = self.parameters
        return typical_motion(self.constraint, self.validity.robot, parameters.step, parameters.native)

    def _projected(self, Q: np.ndarray, iterations: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """As `Constraint.project_batch`, with an eye on the clock."""
        X, converged, block = np.empty_like(Q, float), np.zeros(len(Q), bool), self.constraint.block
        for first in range(0, len(Q), block):
            self.deadline.look()
            rows = slice(first, first + block)
            X[rows], converged[rows] = self.constraint.project_batch(Q[rows], iterations)
        return X, converged

    def _ended(self, reached: list[np.ndarray], stop: Stop) -> Traversal:
        return Traversal(np.array(reached) if reached else np.empty((0, self.dimension)), stop)

    def _finish(
        self, reached: list[np.ndarray], q_from: np.ndarray, q_to: np.ndarray, covered: bool, land: bool
    ) -> Traversal:
        """Within a step of the target: take it, if it and the way to it are free, unless the walk is not to land."""
        if not land:
            return self._ended(reached, Stop.ARRIVED)
        last = reached[-1] if reached else q_from
        offset = q_to - last
        chord = [q_to, *(last + share * offset for share in self._shares)]
        if not self._passable(chord, length(offset), covered)[0]:
            return self._ended(reached, Stop.COLLISION)
        reached.append(np.array(q_to, float))
        return self._ended(reached, Stop.REACHED)

    def _passable(self, chord: Sequence[np.ndarray] | np.ndarray, distance: float, covered: bool) -> tuple[bool, bool]:
        """Tell whether a chord (see `_chord`) of this length is free, and whether its end covers its surroundings.

        A configuration that keeps half a chord's travel more than the margin covers the halves next to it: their points
        need no check. `covered` says so of the configuration where the chord begins.
        """
        free, wide = self.validity.free, self._wide
        if not self._shares:  # a check a step: nothing in between to cover
            return free(chord[0]), False
        covers = wide is not None and wide.free(chord[0])
        if not covers and not free(chord[0]):
            return False, False
        short = distance <= self._covered_length
        if not (covers and short) and not all(free(chord[row]) for row in self._far):
            return False, False
        if not (covered and short) and not all(free(chord[row]) for row in self._near):
            return False, False
        return True, covers

    def _chord(self, q: ca.SX, following: ca.SX) -> list[ca.SX]:
        """Expressions of the points to check between two states, and the second state, as columns: worst first."""
        return [following, *(q + share * (following - q) for share in self._shares)]

    def _compiled(self, name: str, make: Callable[[Bounds], Expressions]) -> Compiled:
        """Return a function that other tasks of the same structure share: of bounds it knows only that there are some.

        Args:
            name: of the function; it may depend on the parameters.
            make: returns its arguments and results, given the symbols of the bounds.
        """

        def bounded() -> Expressions:
            bounds = Bounds.symbols(self._limited)
            arguments, results = make(bounds)
            return Expressions([*arguments, bounds.squared, *bounds.limits], results)

        values: list[np.ndarray | float] = [self.constraint.tolerance**2]
        if len(self._limited):
            values += [self.lower[self._limited], self.upper[self._limited]]
        key = (name, self.parameters, tuple(self._limited.tolist()))
        return self.constraint.compiled(key, bounded, machine=self.parameters.native, bound=values)


def length(v: np.ndarray) -> float:
    """Return ||v||_2; for one short vector a quarter of the price of numpy's norm."""
    return math.sqrt(v @ v)


def first_code(conditions: list[tuple[ca.SX, Stop]]) -> ca.SX:
    """Expression: the code of the first condition that holds, 0 when none does."""
    code = ca.SX(0)
    for condition, stop in reversed(conditions):
        code = ca.if_else(condition, stop.value, code)
    return code
