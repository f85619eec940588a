"""The one runner: a case is planned by a route, its path is verified, and one row says what came of it.

Benchmark, variants, the contest for arms, the parity with OMPL and the soak test are configurations of it.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from pipeline.evaluation.routes import Case, Route
from pipeline.planners import Termination, shortcut
from pipeline.robots import Geometry, UrdfRobot
from pipeline.spec.scene import flatten
from pipeline.spec.statement import Statement
from pipeline.tasks import Task
from pipeline.verification.judge import Judge
from pipeline.verification.verdict import Verdict, VerifierParameters

COLUMNS = (
    "environment", "scenario", "scene", "problem", "leg",  # the case
    "method", "planner", "sampler", "adherence", "role",  # the route, see `Names`
    "seed", "status", "claimed", "planning_time", "network_time", "iterations",  # the plan; times are in seconds
    "traversals", "projections", "collision_checks", "samples", "fallback_samples", "nearest_queries", "network_calls",
    "charts", "repairs",  # counts, NaN where a route has none
    "solved", "failure", "rejection",  # whether the verifier passes what is claimed; if not, why, and a sentence
    "solved_own", "failure_own",  # the same by the geometry that the route planned with
    "path_length",  # of what passes by one of both [rad or m], otherwise NaN
    "max_violation", "min_clearance",  # of what is claimed; the clearance [m] is NaN where it was not asked for
    "states_checked", "chords_proven", "chords_sampled",  # by the verifier
)  # fmt: skip
PATH = ("path", "waypoints", "dimension")  # only of runners that keep paths, see `flatten`
_OF_CASE = 5  # columns
_COUNTED = ("states_checked", "chords_proven", "chords_sampled")
_UNCLAIMED = {  # rows of plans without a path
    **{"solved": False, "failure": "", "rejection": "", "solved_own": False, "failure_own": ""},
    **dict.fromkeys(("path_length", "max_violation", "min_clearance"), np.nan),
    **dict.fromkeys(_COUNTED, 0),
}
_UNSHORTENED = {"shortened": False, "short_failure": "", "short_length": np.nan}  # only of runners that shorten paths


class Judges:
    """Verifiers of what is asked; those of the last statement are kept, as many paths are judged by them.

    Args:
        verifier: bounds of the check.
    """

    def __init__(self, verifier: VerifierParameters | None = None) -> None:
        self.verifier = verifier
        self._asked: Statement | None = None
        self._judges: dict[Geometry | None, Judge] = {}

    def verdict(self, task: Task, path: np.ndarray, geometry: Geometry | None = None) -> Verdict:
        """Return the verdict on a path (T, n), by the robot's own geometry or another."""
        asked = task.statement
        if self._asked is not asked:
            self._asked, self._judges = asked, {}
        if geometry not in self._judges:
            robot = asked.robot
            if geometry is not None and isinstance(robot, UrdfRobot):
                asked = replace(asked, robot=replace(robot, geometry=geometry))
            self._judges[geometry] = Judge(asked, self.verifier)
        return self._judges[geometry].verify(path, task.start, task.goal)


class Runner:
    """Makes trials: all with the same end and the same verifier.

    Args:
        termination: when plans end.
        verifier: bounds of the check.
        shortcuts: tried on every path, the shorter one is verified as well and adds to what was checked; None leaves
            that out.
        paths: whether rows hold paths.
    """

    def __init__(
        self, termination: Termination, verifier: VerifierParameters, shortcuts: int | None = None, paths: bool = False
    ) -> None:
        self.termination, self.shortcuts, self.paths = termination, shortcuts, paths
        self._judges = Judges(verifier)

    def row(self, route: Route, case: Case, seed: int) -> dict[str, Any]:
        """Plan a case, verify the path and return the row: `COLUMNS`, those of shortening and `PATH` where asked for.

        Raises:
            ProblemError: the start or goal is invalid.
        """
        result = route.plan(case, self.termination, seed)
        row = {name: getattr(case, name) for name in COLUMNS[:_OF_CASE]} | vars(route.names)
        row |= {"role": route.names.role.value, **result.row(), **dict.fromkeys(route.uncounted, np.nan)}
        row |= _UNCLAIMED if self.shortcuts is None else {**_UNCLAIMED, **_UNSHORTENED}
        if result.solved:
            verdict = self._judges.verdict(case.task, result.path)
            own = verdict if route.geometry is None else self._judges.verdict(case.task, result.path, route.geometry)
            clearance = np.nan if verdict.min_clearance is None else verdict.min_clearance
            row |= {
                "solved": verdict.passed,
                "failure": _why(verdict),
                "rejection": verdict.message,
                "solved_own": own.passed,
                "failure_own": _why(own),
                "path_length": verdict.length if verdict.passed or own.passed else np.nan,
                "max_violation": verdict.max_violation,
                "min_clearance": clearance,
                **{name: getattr(own, name) for name in _COUNTED},
            }
            if self.shortcuts:
                space = route.manifold.at(case.task)
                space.reset()
                path = shortcut(space, result.path, np.random.default_rng([seed, 2]), self.shortcuts)
                after = self._judges.verdict(case.task, path)
                row |= {"shortened": True, "short_failure": _why(after), "short_length": after.length}
                row |= {name: row[name] + getattr(after, name) for name in _COUNTED}
        return {**row, **flatten(result.path)} if self.paths else row


def _why(verdict: Verdict) -> str:
    return verdict.failure.value if verdict.failure else ""
