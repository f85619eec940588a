"""OMPL's own planners on our manifolds: baselines to compare with, and an independent check of our planners.

What OMPL 2.0.1 lets Python replace decides the cut: constraint and validity are ours; sampling, charts and search are
OMPL's. It keeps the interpreter lock while it searches, so a planner with a second thread (PRM) deadlocks on a
termination condition written in Python and is stopped by OMPL's own clock.

Repeatability: every random stream of OMPL takes its seed from one global generator when it is made. That generator is
seeded before each plan and everything that draws is made after that, so one seed gives one path, in any process and
after any other plans. Not repeatable: what a time limit cuts off, and PRM and PRMstar, whose two threads race.
"""

import inspect
import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from pipeline.constraints import Constraint
from pipeline.errors import ConfigError, require
from pipeline.planners.base import PlanResult, PlanStatus, Query, Termination

_log = logging.getLogger(__name__)
_SPACES = {
    "projection": (ob.ProjectedStateSpace, ob.ConstrainedSpaceInformation),
    "atlas": (ob.AtlasStateSpace, ob.ConstrainedSpaceInformation),
    "tangent_bundle": (ob.TangentBundleStateSpace, ob.TangentBundleSpaceInformation),
}
_THREADED = ("PRM", "PRMstar")
_ENDLESS = ("AORRTC",)  # shortens paths in a loop that, on a manifold, neither ends nor looks at the clock
_SAME = 1e-9  # start and goal come back from OMPL as they went in, but for rounding


@dataclass(frozen=True)
class OmplParameters:
    """OMPL's parameters; the defaults are OMPL 2.0.1's.

    Attributes:
        delta: step on the manifold [rad or m].
        leap: lambda; a step longer than this many deltas ends a walk, and in charts a walk this many times the straight
            line. Above 1.
        epsilon: charts only: farthest from the manifold [rad or m].
        rho: charts only: radius, five deltas [rad or m]. FMT draws its samples before it walks, hence within
            rho / (1 - exploration)^(1/d), along the tangent space, of start and goal on a manifold of dimension d; in
            the tangent bundle, where short walks make no charts, it then never gets farther. There it needs more than
            OMPL's default.
        alpha: charts only: largest angle to the manifold [rad].
        exploration: charts only: in [0, 1), how far beyond a chart's radius samples are drawn.
        backoff: charts only: a step that is too long is tried again this much shorter.
        charts_per_extension: charts only: most charts that one walk may add.
        separated: atlas only: whether charts are cut where they meet.
        range: longest motion a planner adds [rad or m]; None leaves it to OMPL (a fifth of the space).
        num_samples: FMT and BFMT: samples of the first batch.
        radius_multiplier: FMT and BFMT: of the connection radius.
        project_override: False is OMPL used the ordinary way, whose Newton iteration asks Python for each value and
            each Jacobian. True puts `Constraint.project` in its place, one call per projection; in the projection
            space only, because charts have an iteration of their own that cannot be replaced.
    """

    delta: float = 0.05
    leap: float = 2.0
    epsilon: float = 0.05
    rho: float = 0.25
    alpha: float = np.pi / 8
    exploration: float = 0.75
    backoff: float = 0.75
    charts_per_extension: int = 200
    separated: bool = True
    range: float | None = None
    num_samples: int = 1000
    radius_multiplier: float = 1.1
    project_override: bool = False

    def __post_init__(self) -> None:
        require("ompl.exploration", self.exploration, at_least=0, below=1)
        bounds = {"leap": (1, np.inf), "alpha": (0, np.pi / 2), "backoff": (0, 1)}
        rest = ("delta", "epsilon", "rho", "charts_per_extension", "range", "num_samples", "radius_multiplier")
        for name in (*bounds, *rest):
            value, (above, below) = getattr(self, name), bounds.get(name, (0, np.inf))
            if value is not None:
                require(f"ompl.{name}", value, above=above, below=below)


@dataclass
class Callbacks:
    """How often OMPL asked Python during one plan."""

    values: int = 0  # of the constraint
    jacobians: int = 0
    projections: int = 0  # only where `project` is overridden
    states: int = 0  # validity
    terminations: int = 0  # most planners ask once per round of their outer loop
    end: float = field(default=np.inf, compare=False)  # of the search, by time.perf_counter [s]

    def over(self) -> bool:
        """True when the search has no time left.

        Planners ask that once per round, in which they may walk and project for a second: from then on every state is
        invalid and every constraint is met, so that walks and projections end at once and nothing more is found.
        """
        return time.perf_counter() >= self.end


def available_planners() -> tuple[str, ...]:
    """Return the names of OMPL's geometric planners that are bound in Python and end on a manifold."""
    found = inspect.getmembers(og, lambda member: inspect.isclass(member) and issubclass(member, ob.Planner))
    return tuple(name for name, _ in found if name not in _ENDLESS)


class OmplPlanner:
    """One of OMPL's planners on one of its constrained state spaces.

    Attributes:
        callbacks: of the last plan.
        stand_ins: a constraint (n, k, tolerance, max_iterations, `value`, `jacobian`) and a checker (`free`) that OMPL
            gets in the place of the problem's; None for these.

    Raises:
        ConfigError: no such planner or space, or a parameter that they do not have.
    """

    def __init__(
        self,
        planner: str,
        space: str,
        parameters: OmplParameters | None = None,
        stand_ins: tuple[Any, Any] | None = None,
    ) -> None:
        self.planner, self.space, self.parameters = planner, space, parameters or OmplParameters()
        self.stand_ins = stand_ins
        self.callbacks = Callbacks()
        if planner not in available_planners():
            raise ConfigError(f"OMPL has no planner {planner!r} for us; it has: {', '.join(available_planners())}")
        if space not in _SPACES:
            raise ConfigError(f"OMPL has no constrained space {space!r}; it has: {', '.join(_SPACES)}")
        if self.parameters.range is not None and not hasattr(getattr(og, planner), "setRange"):
            raise ConfigError(f"ompl.range is {self.parameters.range}, but {planner} has no range; leave it empty")
        if self.parameters.project_override and space != "projection":
            raise ConfigError(f"ompl.project_override needs the space 'projection'; {space!r} projects by its charts")

    def plan(self, query: Query, termination: Termination, seed: int) -> PlanResult:
        """Search until solved or terminated. Failure is a result, and so is an approximate solution: a failure.

        The path is OMPL's, interpolated on the manifold in steps of about delta, without a finer walk: what touches or
        jumps between its states is left to the verifier. The time is that of charts, search and interpolation.
        `counters.projections` is exact where `project` is overridden; otherwise it is the values less the Jacobians,
        because a Newton iteration ends on a value: that counts every test for the manifold as a projection.

        OMPL's spaces are R^n: where joints turn, the goal is put at the turns nearest to the start, and their variables
        are bounded half a turn beyond both. A way round that needs more than that is not found.

        Raises:
            ProblemError: the start or goal is invalid (see `Query.check`).
            ConfigError: an iteration limit for a planner that only a clock can stop.
        """
        if self.planner in _THREADED and termination.max_iterations is not None:
            raise ConfigError(f"{self.planner} has a second thread and ends by time_limit only; empty max_iterations")
        query.check()
        query = _flat(query)
        query.adherence.reset()
        calls = self.callbacks = Callbacks()
        with _silent():
            # OMPL refuses 0 and takes 32 bits.
            ou.RNG.setSeed(max(1, int(np.random.SeedSequence(seed).generate_state(1)[0])))
            status, path, elapsed, charts = self._solve(query, termination, calls)
        ordinary = max(0, calls.values - calls.jacobians)
        projections = calls.projections if self.parameters.project_override else ordinary
        return PlanResult(
            status=status,
            path=path,
            planning_time=elapsed,
            network_time=0.0,
            iterations=calls.terminations,
            counters=replace(query.adherence.counted(), projections=projections, charts=charts),
            seed=seed,
        )

    def samples(self, query: Query, count: int, seed: int) -> np.ndarray:
        """Return what the space draws before any walk: with charts, around start and goal (count, n).

        Some may be off the manifold, in collision or outside the bounds: planners drop these.
        """
        query = _flat(query)
        dimension, calls = query.adherence.dimension, Callbacks()
        with _silent():
            ou.RNG.setSeed(max(1, int(np.random.SeedSequence(seed).generate_state(1)[0])))
            space = self._space(query, calls)
            information = _SPACES[self.space][1](space)
            information.setStateValidityChecker(_checker(query, calls, self.stand_ins))
            information.setup()
            self._anchor(space, *(_state(space, q) for q in (query.start, query.goal)))
            sampler, state, drawn = space.allocStateSampler(), space.allocState(), np.empty((count, dimension))
            for row in drawn:
                sampler.sampleUniform(state)
                row[:] = [state[i] for i in range(dimension)]
        return drawn

    def _solve(
        self, query: Query, termination: Termination, calls: Callbacks
    ) -> tuple[PlanStatus, np.ndarray, float, int]:
        """Return status, path (T, n), time [s] and number of charts. Everything is made anew, nothing outlives it."""
        dimension, charted = query.adherence.dimension, self.space != "projection"
        path, charts = np.empty((0, dimension)), 0
        space = self._space(query, calls)
        information = _SPACES[self.space][1](space)
        information.setStateValidityChecker(_checker(query, calls, self.stand_ins))
        information.setup()
        start, goal = _state(space, query.start), _state(space, query.goal)
        definition = ob.ProblemDefinition(information)
        definition.setStartAndGoalStates(start, goal)
        objective = ob.PathLengthOptimizationObjective(information)
        # Without a threshold a planner that improves paths would use up the time limit.
        objective.setCostThreshold(ob.Cost(np.inf if termination.cost_below is None else termination.cost_below))
        definition.setOptimizationObjective(objective)
        planner = self._planner(information, definition)
        begin = time.perf_counter()
        try:
            self._anchor(space, start, goal)
            ending = planner.solve(self._condition(termination, calls))
            calls.end = np.inf  # a path found in time is walked once more
            charts = space.getChartCount() if charted else 0
            # bool(ending) is True for approximate solutions as well.
            if ending.getStatus() == ob.PlannerStatus.EXACT_SOLUTION:
                solution = definition.getSolutionPath()
                solution.interpolate()
                states = np.array([[state[i] for i in range(dimension)] for state in solution.getStates()])
                path = _joined(states, query)
        except RuntimeError as error:  # an ompl::Exception; ours are not RuntimeErrors
            _log.warning("OMPL's %s in the %s space gave up: %s", self.planner, self.space, error)
        elapsed = time.perf_counter() - begin
        return (PlanStatus.SOLVED if len(path) else _unsolved(termination, calls, elapsed)), path, elapsed, charts

    def _space(self, query: Query, calls: Callbacks) -> Any:
        adherence = query.adherence
        ambient, bounds = ob.RealVectorStateSpace(adherence.dimension), ob.RealVectorBounds(adherence.dimension)
        for joint, (low, high) in enumerate(_bounds(query)):
            bounds.setLow(joint, low)
            bounds.setHigh(joint, high)
        ambient.setBounds(bounds)
        overridden = self.parameters.project_override
        given = adherence.constraint if self.stand_ins is None else self.stand_ins[0]
        constraint = (_Projecting if overridden else _Ordinary)(given, calls)
        space, parameters = _SPACES[self.space][0](ambient, constraint), self.parameters
        space.setDelta(parameters.delta)
        space.setLambda(parameters.leap)
        if self.space != "projection":
            space.setEpsilon(parameters.epsilon)
            space.setRho(parameters.rho)
            space.setAlpha(parameters.alpha)
            space.setExploration(parameters.exploration)
            space.setBackoff(parameters.backoff)
            space.setMaxChartsPerExtension(parameters.charts_per_extension)
        if self.space == "atlas":
            space.setSeparated(parameters.separated)
        return space

    def _anchor(self, space: Any, start: Any, goal: Any) -> None:
        """Begin charts at start and goal.

        The tangent bundle never draws from the first chart (its weight is how far it is from other anchors when it is
        made), so the start gets a second one: FMT would have samples around the goal only.
        """
        ends = {"projection": (), "atlas": (start, goal), "tangent_bundle": (start, goal, start)}
        for end in ends[self.space]:
            space.anchorChart(end)

    def _planner(self, information: Any, definition: Any) -> Any:
        planner = getattr(og, self.planner)(information)
        planner.setProblemDefinition(definition)
        if self.parameters.range is not None:
            planner.setRange(self.parameters.range)
        if self.planner in ("FMT", "BFMT"):
            planner.setNumSamples(self.parameters.num_samples)
            planner.setRadiusMultiplier(self.parameters.radius_multiplier)
        planner.setup()
        return planner

    def _condition(self, termination: Termination, calls: Callbacks) -> Any:
        if self.planner in _THREADED:
            return ob.timedPlannerTerminationCondition(termination.time_limit)
        limit = np.inf if termination.max_iterations is None else termination.max_iterations
        duration = np.inf if termination.time_limit is None else termination.time_limit
        calls.end = time.perf_counter() + duration

        def over() -> bool:
            if calls.terminations >= limit or calls.over():
                return True
            calls.terminations += 1
            return False

        return ob.PlannerTerminationCondition(over)


class _Ordinary(ob.Constraint):  # type: ignore[misc]  # OMPL has no types
    """Our constraint as OMPL wants it. Holds no OMPL object, so that reference counts free everything."""

    def __init__(self, constraint: Constraint, calls: Callbacks) -> None:
        super().__init__(constraint.n, constraint.k, constraint.tolerance)
        self.setMaxIterations(constraint.max_iterations)
        self._ours, self._calls = constraint, calls

    def function(self, x: np.ndarray, out: np.ndarray) -> None:
        self._calls.values += 1
        out[:] = 0.0 if self._calls.over() else self._ours.value(x)

    def jacobian(self, x: np.ndarray, out: np.ndarray) -> None:
        self._calls.jacobians += 1
        out[:] = self._ours.jacobian(x)


class _Projecting(_Ordinary):
    def project(self, x: np.ndarray) -> bool:
        self._calls.projections += 1
        if self._calls.over():
            return True
        found = self._ours.project(x)
        x[:] = found.q
        return bool(found.converged)  # a numpy.bool aborts the interpreter


def _state(space: Any, q: np.ndarray) -> Any:
    """The wrapper owns the state: `freeState` on it would free it twice."""
    state = space.allocState()
    state.copy(np.asarray(q, float).tolist())
    return state


def _checker(query: Query, calls: Callbacks, stand_ins: tuple[Any, Any] | None) -> Callable[[Any], bool]:
    """OMPL checks joint limits nowhere on a walk: they are part of validity here."""
    bounds = tuple((i, low, high) for i, (low, high) in enumerate(_bounds(query)))
    free = query.adherence.validity.free if stand_ins is None else stand_ins[1].free

    def valid(state: Any) -> bool:
        calls.states += 1
        if calls.over():
            return False
        q = [state[i] for i, _, _ in bounds]
        return all(low <= q[i] <= high for i, low, high in bounds) and free(np.array(q))

    return valid


def _flat(query: Query) -> Query:
    """Return the query with its goal at the turns nearest to the start."""
    turns = query.adherence.turns
    return query if turns is None else replace(query, goals=turns.nearest(query.goals, query.start))


def _bounds(query: Query) -> list[tuple[float, float]]:
    """Return the bounds of every variable: its limits; of one that turns, half a turn beyond start and goal."""
    low, high = query.adherence.lower, query.adherence.upper
    ends = np.stack([query.start, query.goal])
    low = np.where(np.isfinite(low), low, ends.min(axis=0) - np.pi)
    high = np.where(np.isfinite(high), high, ends.max(axis=0) + np.pi)
    return list(zip(low.tolist(), high.tolist(), strict=True))


def _joined(states: np.ndarray, query: Query) -> np.ndarray:
    """Return the states (T, n) without repetitions, or (0, n) when they do not run from start to goal."""
    if not (np.abs(states[0] - query.start).max() < _SAME and np.abs(states[-1] - query.goal).max() < _SAME):
        return np.empty((0, states.shape[1]))
    moved = np.abs(np.diff(states, axis=0)).max(axis=1) > _SAME  # OMPL repeats the states where two walks meet
    states = np.vstack([query.start, states[1:][moved]])
    states[-1] = query.goal
    return states


def _unsolved(termination: Termination, calls: Callbacks, elapsed: float) -> PlanStatus:
    if termination.max_iterations is not None and calls.terminations >= termination.max_iterations:
        return PlanStatus.ITERATION_LIMIT
    if termination.time_limit is not None and elapsed >= termination.time_limit:
        return PlanStatus.TIME_LIMIT
    return PlanStatus.FAILED


@contextmanager
def _silent() -> Iterator[None]:
    """OMPL reports progress on stdout and complains about every new seed."""
    level = ou.getLogLevel()
    ou.setLogLevel(ou.LogLevel.LOG_NONE)
    try:
        yield
    finally:
        ou.setLogLevel(level)
