"""Continuation-based adherence: Algorithms 3 (atlas) and 4 (tangent bundle) of compnetx.txt, section II-C."""

from dataclasses import replace

import casadi as ca
import numpy as np

from pipeline.constraints import Constraint, Expressions
from pipeline.manifolds.atlas import Atlas, AtlasParameters, Chart
from pipeline.manifolds.base import Adherence, Bounds, Stop, Traversal, first_code, length
from pipeline.robots import Validity

_SAMPLE_BLOCK = 64  # samples at most that are drawn and lifted together, before the atlas grows over the first of them
_SAMPLE_GROWTH = 4  # samples of a block that get a chart: enough to spread, more cost a fifth of a plan
_SAMPLE_ROUNDS = 50  # blocks that are drawn, and one more for every 8 samples, before sampling gives up
_LIFT_BLOCK = 256  # lifted together where the atlas does not grow in between: half the price of four small blocks


class ContinuationAdherence(Adherence):
    """Walks in charts. Use `AtlasAdherence` or `TangentBundleAdherence`."""

    lazy: bool  # whether steps stay in the tangent space and are projected only when a chart is left

    def __init__(self, constraint: Constraint, validity: Validity, parameters: AtlasParameters) -> None:
        super().__init__(constraint, validity, parameters)
        self.parameters: AtlasParameters = parameters
        self.atlas = Atlas(constraint, parameters, self.turns)
        self._charts: dict[bytes, Chart] = {}  # of states that walks began or ended at
        self._edge = self._compiled(f"{'bundle' if self.lazy else 'atlas'}_edge", self._edge_expressions)
        self._psi = self._compiled("psi", self._psi_expressions)
        self._lift_few, self._lift_many = (
            constraint.compiled(("lift",), self._lift_expressions, size, parameters.native)
            for size in (_SAMPLE_BLOCK, _LIFT_BLOCK)
        )

    def reset(self, validity: Validity | None = None) -> None:
        """Forget the last problem and its charts."""
        super().reset(validity)
        self.atlas = Atlas(self.constraint, self.parameters, self.turns)
        self._charts = {}

    def anchor(self, q: np.ndarray) -> None:
        """Begin the atlas with a chart at q."""
        self._chart_at(q)

    def exponential(self, chart: Chart, u: np.ndarray) -> np.ndarray | None:
        """Return psi(u), the manifold's point orthogonally above u (d,) (eq. 3); None without convergence."""
        self.counters.projections += 1
        q, violation = self._psi(chart.origin, chart.tangent.T, chart.normal.T, u)
        return q.copy() if violation[0] < self.constraint.tolerance**2 else None

    def traverse(
        self, q_from: np.ndarray, q_to: np.ndarray, max_states: int | None = None, land: bool = True
    ) -> Traversal:
        """Walk by Algorithm 3 or 4."""
        self.counters.traversals += 1
        if self.turns is None:
            return self._walk(q_from, q_to, max_states, land)
        walk = self._walk(q_from, self.turns.nearest(q_to, q_from), max_states, land)
        # Each chart has its states at the turns nearest to its origin.
        return replace(walk, states=self.turns.unwrapped(np.concatenate([q_from[None], walk.states]))[1:])

    def _walk(self, q_from: np.ndarray, q_to: np.ndarray, max_states: int | None, land: bool) -> Traversal:
        parameters = self.parameters
        straight = length(q_to - q_from)
        reached: list[np.ndarray] = []
        limit = min(self.parameters.max_steps, max_states or self.parameters.max_steps)
        if straight <= parameters.step:
            return self._finish(reached, q_from, q_to, False, land)
        chart = self._chart_at(q_from)
        if chart is None:
            return self._ended(reached, Stop.NO_CHART)
        q, q_to = q_from, q_to = self.atlas.seen(chart, q_from, q_to)
        u, target = chart.log(q), chart.log(q_to)
        way, longest, covered = 0.0, parameters.wander * straight, False
        while True:
            self.deadline.look()
            if length(target - u) <= parameters.step:  # line 7, right at the beginning of a chart
                near = length(q_to - q) <= parameters.leap * parameters.step
                return self._finish(reached, q_from, q_to, covered, land) if near else self._ended(reached, Stop.FOLDED)
            flat, coordinates, codes, ways, gaps = self._edge(
                chart.origin, chart.tangent.T, chart.normal.T, u, q, q_to, target, way, longest
            )
            coordinates = coordinates.reshape(len(codes), -1)  # a lookahead of 1 comes as a vector
            outside = self.atlas.outside(chart, coordinates).tolist()
            chords, coordinates = flat.reshape(len(codes), -1, self.dimension).copy(), coordinates.copy()
            to_target, totals = gaps.tolist(), ways.tolist()
            for i, code in enumerate(codes.tolist()):
                chord, distance, way = chords[i], totals[i] - way, totals[i]
                self.counters.projections += not self.lazy
                if code and code < Stop.ARRIVED.value:
                    return self._ended(reached, Stop(int(code)))
                leaves = code == Stop.LEFT_CHART.value or outside[i]
                if leaves and self.lazy:
                    lifted = self.exponential(chart, coordinates[i])  # Algorithm 4, line 17
                    if lifted is None:
                        return self._ended(reached, Stop.NOT_CONVERGED)
                    if (lifted < self.lower).any() or (lifted > self.upper).any():
                        return self._ended(reached, Stop.OUT_OF_BOUNDS)
                    chord[0] = lifted
                    covered, distance = False, np.inf  # the chord was computed to where it was before
                passable, covered = self._passable(chord, distance, covered)
                if not passable:
                    return self._ended(reached, Stop.COLLISION)
                reached.append(chord[0])
                if to_target[i] <= parameters.step:
                    return self._finish(reached, q_from, q_to, covered, land)
                if code == Stop.ARRIVED.value and not leaves:  # over the target in the chart, or on another fold
                    near = to_target[i] <= parameters.leap * parameters.step
                    return (
                        self._finish(reached, q_from, q_to, covered, land)
                        if near
                        else self._ended(reached, Stop.FOLDED)
                    )
                if len(reached) >= limit:
                    return self._ended(reached, Stop.STEP_LIMIT)
                if leaves:
                    break
                self._charts[chord[0].tobytes()] = chart
            q, u = chord[0], coordinates[i]
            if leaves:
                following = self._chart_at(q)
                if following is None:
                    return self._ended(reached, Stop.NO_CHART)
                chart = following
                q, q_to = self.atlas.seen(chart, q, q_to)
                reached[-1] = q
                u, target = chart.log(q), chart.log(q_to)

    def sample(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Sample charts and their tangent balls beyond rho (IMACS), lift, and grow the atlas over some of the samples.

        Raises no error when the atlas cannot be sampled: fewer rows come back.
        """
        found = np.empty((0, self.dimension))
        for _ in range(_SAMPLE_ROUNDS + count // 8 if len(self.atlas) else 0):
            size = min(_SAMPLE_BLOCK, count - len(found))
            if not size:
                break
            self.deadline.look()
            Q = self._drawn(rng, rng.integers(len(self.atlas), size=size))
            for q in Q[:_SAMPLE_GROWTH]:
                self._chart_at(q)
            found = np.concatenate([found, Q])
        return found

    def sample_around(self, rng: np.random.Generator, Q: np.ndarray) -> np.ndarray:
        """Sample the tangent balls of charts at Q, as `sample` those of any chart."""
        ends, which = np.unique(Q, axis=0, return_inverse=True)
        charts = [self._chart_at(q) for q in ends]
        self.deadline.look()
        places = np.array([-1 if chart is None else chart.index for chart in charts], int)[which]
        places = places[places >= 0]
        blocks = [self._drawn(rng, places[i : i + _LIFT_BLOCK]) for i in range(0, len(places), _LIFT_BLOCK)]
        return np.concatenate([np.empty((0, self.dimension)), *blocks])

    def _drawn(self, rng: np.random.Generator, charts: np.ndarray) -> np.ndarray:
        """Return a sample of each chart (m,), but for those that cannot be lifted or are out of bounds."""
        parameters, d = self.parameters, self.constraint.manifold_dimension
        radius = parameters.rho / (1.0 - parameters.exploration) ** (1.0 / d)
        directions = rng.normal(size=(len(charts), d))
        lengths = radius * rng.random((len(charts), 1)) ** (1.0 / d)
        Q, lifted = self._lift(charts, directions * (lengths / np.linalg.norm(directions, axis=1, keepdims=True)))
        Q = np.asarray(Q[lifted & ((Q >= self.lower) & (Q <= self.upper)).all(axis=1)])
        return Q if self.turns is None else self.turns.canonical(Q)

    def _lift(self, charts: np.ndarray, U: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return psi(u) for up to a block of charts (m,) and coordinates (m, d), and where it converged (m,)."""
        count, atlas = len(charts), self.atlas
        block = self._lift_few if count <= _SAMPLE_BLOCK else self._lift_many
        self.counters.projections += count
        normals = atlas.normals[charts]  # (m, k, n)
        bases = atlas.origins[charts] + np.einsum("md,mdn->mn", U, atlas.tangents[charts])
        heights = np.zeros((count, self.constraint.k))
        base, normal, height = (argument.reshape(len(block.arguments[0]), -1) for argument in block.arguments)
        base[:count], normal[:count] = bases, normals.reshape(count, -1)
        for _ in range(3 * self.parameters.newton_steps):
            self.deadline.look()
            height[:count] = heights
            violations, following = (result.reshape(len(base), -1)[:count] for result in block.evaluate())
            done = violations[:, 0] < self.constraint.tolerance**2
            if done.all():
                break
            heights = np.where(done[:, None], heights, following)
        return bases + np.einsum("mk,mkn->mn", heights, normals), done

    def _chart_at(self, q: np.ndarray) -> Chart | None:
        key = q.tobytes()
        chart = self._charts.get(key)
        if chart is None:
            chart = self.atlas.at(q)
            self.counters.charts = len(self.atlas)
            if chart is not None:
                self._charts[key] = chart
        return chart

    def _chart_symbols(self) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        n, k = self.constraint.n, self.constraint.k
        return ca.SX.sym("origin", n), ca.SX.sym("tangent", n, n - k), ca.SX.sym("normal", n, k), ca.SX.sym("u", n - k)

    def _lift_expressions(self) -> Expressions:
        """One Newton step along the normal of a chart: ||F||^2 before it, and the height after it."""
        n, k, structure = self.constraint.n, self.constraint.k, self.constraint.structure
        base, normal, y = ca.SX.sym("base", n), ca.SX.sym("normal", n, k), ca.SX.sym("y", k)
        F, J = structure.rows_and_jacobian(base + normal @ y)
        return Expressions([base, normal, y], [ca.sumsqr(F), y - ca.solve(J @ normal, F)])

    def _psi_expressions(self, bounds: Bounds) -> Expressions:
        origin, tangent, normal, u = self._chart_symbols()
        iterations, flat = 3 * self.parameters.newton_steps, ca.SX.zeros(self.constraint.k)
        q, _, violation = self._exponential(origin + tangent @ u, normal, flat, iterations, bounds.squared)
        return Expressions([origin, tangent, normal, u], [q, violation])

    def _exponential(
        self, base: ca.SX, normal: ca.SX, y: ca.SX, iterations: int, squared: ca.SX
    ) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Solve eq. (3) from phi(u) = base: Newton on F(base + N y) = 0, which keeps Phi^T (q - base) = 0 by itself.

        Returns q, y and ||F(q)||^2.
        """
        structure = self.constraint.structure
        for _ in range(iterations):
            F, J = structure.rows_and_jacobian(base + normal @ y)
            y = ca.if_else(ca.sumsqr(F) < squared, y, y - ca.solve(J @ normal, F))
        q = base + normal @ y
        return q, y, ca.sumsqr(structure.rows(q))

    def _edge_expressions(self, bounds: Bounds) -> Expressions:
        """Steps along a straight line in one chart, with the code of the first condition that ends each."""
        constraint, parameters = self.constraint, self.parameters
        gamma = parameters.step
        origin, tangent, normal, u = self._chart_symbols()
        q_from, target = ca.SX.sym("q", constraint.n), ca.SX.sym("target", constraint.n)
        u_target, way, longest = ca.SX.sym("u_target", u.numel()), ca.SX.sym("way"), ca.SX.sym("longest")
        direction = (u_target - u) / ca.norm_2(u_target - u)
        q, D, y = q_from, way, normal.T @ (q_from - origin)
        points, coordinates, codes, ways, gaps = [], [], [], [], []
        for i in range(parameters.lookahead):
            d1 = ca.norm_2(target - q)
            u_next = u + (i + 1) * gamma * direction
            base = origin + tangent @ u_next
            if self.lazy:
                following = base
                converged = ca.SX(1)
                # Algorithm 4, line 16, prints |phi(u_i) - q_i| > epsilon, which is 0 there: what can leave epsilon is
                # the distance to the manifold, here to first order |F|.
                gap = ca.norm_2(constraint.structure.rows(base))
            else:
                following, y, violation = self._exponential(base, normal, y, parameters.newton_steps, bounds.squared)
                converged = violation < bounds.squared
                gap = ca.norm_2(following - base)
            d, d2 = ca.norm_2(following - q), ca.norm_2(target - following)
            D = D + d
            length = ca.norm_2(u_next)
            left = ca.logic_or(
                ca.logic_or(gap > parameters.epsilon, length > parameters.rho),
                length < np.cos(parameters.alpha) * ca.norm_2(following - origin),
            )
            codes.append(
                first_code(
                    [
                        (ca.logic_not(converged), Stop.NOT_CONVERGED),
                        (d2 > d1, Stop.AWAY),
                        (d > parameters.leap * gamma, Stop.LEAP),
                        (d < parameters.epsilon, Stop.STALLED),
                        (D > longest, Stop.WANDERED),
                        (ca.logic_not(bounds.inside(following)), Stop.OUT_OF_BOUNDS),
                        (left, Stop.LEFT_CHART),
                        (ca.norm_2(u_target - u_next) <= gamma, Stop.ARRIVED),
                    ]
                )
            )
            points += self._chord(q, following)
            coordinates.append(u_next)
            ways.append(D)
            gaps.append(d2)
            q = following
        arguments = [origin, tangent, normal, u, q_from, target, u_target, way, longest]
        columns = [ca.vertcat(*codes), ca.vertcat(*ways), ca.vertcat(*gaps)]
        return Expressions(arguments, [ca.horzcat(*points), ca.horzcat(*coordinates), *columns])


class AtlasAdherence(ContinuationAdherence):
    """Every state on the manifold, charts kept apart by half-spaces: Algorithm 3."""

    lazy = False


class TangentBundleAdherence(ContinuationAdherence):
    """States in the tangent spaces, within epsilon of the manifold, lifted when a chart is left: Algorithm 4.

    Charts overlap (no half-spaces). `refine` brings the states of a found path onto the manifold.
    """

    lazy = True

    def __init__(self, constraint: Constraint, validity: Validity, parameters: AtlasParameters) -> None:
        super().__init__(constraint, validity, replace(parameters, separate=False))
