"""Algorithms 1 to 4 of compnetx.txt, one step at a time in plain numpy, with the corrections the library documents.

Nothing is shared with the library: kinematics, Jacobians, collisions, charts and half-spaces are computed here.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.manifolds import AdherenceParameters, AtlasParameters, Stop

norm = np.linalg.norm


@dataclass
class World:
    """A manifold and what is free on it.

    Attributes:
        value, jacobian: F (k,) and dF/dq (k, n) of a configuration (n,).
        free: whether a configuration is free of collision.
        lower, upper: bounds (n,).
        tolerance: of ||F||.
    """

    value: Callable[[np.ndarray], np.ndarray]
    jacobian: Callable[[np.ndarray], np.ndarray]
    free: Callable[[np.ndarray], bool]
    lower: np.ndarray
    upper: np.ndarray
    tolerance: float

    def inside(self, q: np.ndarray) -> bool:
        return bool((q >= self.lower).all() and (q <= self.upper).all())

    def project(self, q: np.ndarray, steps: int) -> np.ndarray | None:
        """Algorithm 1; None where it does not converge."""
        for _ in range(steps):
            if norm(self.value(q)) < self.tolerance:
                return q
            q = q - np.linalg.pinv(self.jacobian(q)) @ self.value(q)
        return q if norm(self.value(q)) < self.tolerance else None


def way_is_free(world: World, P: AdherenceParameters, q: np.ndarray, following: np.ndarray) -> bool:
    """Collisions are checked at `resolution` along a step, its end included (architecture.md, two steps)."""
    pieces = int(np.ceil(P.step / P.resolution - 1e-9))
    return all(world.free(q + i / pieces * (following - q)) for i in range(1, pieces + 1))


def finish(world: World, P: AdherenceParameters, states: list, q_s: np.ndarray, q_e: np.ndarray):
    """Within a step of the target: take it, if the way to it is free."""
    if not way_is_free(world, P, states[-1] if states else q_s, q_e):
        return states, Stop.COLLISION
    return [*states, q_e], Stop.REACHED


def diverges(P: AdherenceParameters, d1: float, d2: float, d: float, D: float, d_w: float, stall: float) -> Stop | None:
    """Line 8 of Algorithm 2, line 13 of Algorithms 3 and 4, without collision and loop limit."""
    if d2 > d1:
        return Stop.AWAY
    if d > P.leap * P.step:
        return Stop.LEAP
    if d < stall:
        return Stop.STALLED
    if D > P.wander * d_w:
        return Stop.WANDERED
    return None


def projection_walk(world: World, P: AdherenceParameters, q_s: np.ndarray, q_e: np.ndarray, limit: int | None = None):
    """Algorithm 2, with steps of length gamma (as in Algorithms 3 and 4); returns the states and why it stopped."""
    N = min(P.max_steps, limit or P.max_steps)
    states, D, d_w, q = [], 0.0, norm(q_e - q_s), q_s
    if d_w <= P.step:
        return finish(world, P, states, q_s, q_e)
    while True:
        following = world.project(q + P.step * (q_e - q) / norm(q_e - q), P.newton_steps)
        if following is None:
            return states, Stop.NOT_CONVERGED
        d = norm(following - q)
        D += d
        d1, d2 = norm(q - q_e), norm(following - q_e)
        stop = diverges(P, d1, d2, d, D, d_w, 0.0)
        if stop is None and not world.inside(following):
            stop = Stop.OUT_OF_BOUNDS
        if stop is None and not way_is_free(world, P, q, following):
            stop = Stop.COLLISION
        if stop is not None:
            return states, stop
        states.append(following)
        if d2 <= P.step:
            return finish(world, P, states, q_s, q_e)
        if len(states) >= N:
            return states, Stop.STEP_LIMIT
        q = following


@dataclass
class LiteralChart:
    """A chart with a basis from a QR decomposition."""

    origin: np.ndarray
    tangent: np.ndarray
    normal: np.ndarray

    def phi(self, u: np.ndarray) -> np.ndarray:
        return self.origin + self.tangent @ u  # eq. 2

    def log(self, q: np.ndarray) -> np.ndarray:
        return self.tangent.T @ (q - self.origin)  # eq. 4


class LiteralAtlas:
    """Charts found among the four with the nearest origins, nearest first.

    Args:
        world: the manifold.
        parameters: of charts.
        separate: whether half-spaces keep charts apart.
    """

    def __init__(self, world: World, parameters: AtlasParameters, separate: bool) -> None:
        self.world, self.P, self.separate = world, parameters, separate
        self.charts: list[LiteralChart] = []

    def psi(self, chart: LiteralChart, u: np.ndarray, steps: int) -> np.ndarray | None:
        """Eq. (3) by Newton's method on all n equations at once; None where it does not converge."""
        base = chart.phi(u)
        q = base
        for _ in range(steps):
            residual = np.concatenate([self.world.value(q), chart.tangent.T @ (q - base)])
            if norm(residual) < self.world.tolerance:
                return q
            q = q - np.linalg.solve(np.vstack([self.world.jacobian(q), chart.tangent.T]), residual)
        return q if norm(self.world.value(q)) < self.world.tolerance else None

    def region_validity(self, chart: LiteralChart, u: np.ndarray, q: np.ndarray) -> bool:
        """Eq. (5), the condition on the angle the right way round."""
        return bool(
            norm(chart.phi(u) - q) <= self.P.epsilon
            and norm(u) >= np.cos(self.P.alpha) * norm(q - chart.origin)
            and norm(u) <= self.P.rho
        )

    def in_polytope(self, chart: LiteralChart, u: np.ndarray) -> bool:
        """On this chart's side of the half-spaces halfway to all others within 2 rho and alpha."""
        if not self.separate:
            return True
        for other in self.charts:
            offset = other.origin - chart.origin
            w = chart.tangent.T @ offset
            near = norm(offset) < 2 * self.P.rho and norm(w) >= np.cos(self.P.alpha) * norm(offset)
            if other is not chart and near and u @ w > w @ w / 2:
                return False
        return True

    def get_chart(self, q: np.ndarray) -> LiteralChart | None:
        for chart in sorted(self.charts, key=lambda chart: norm(chart.origin - q))[:4]:
            u = chart.log(q)
            if self.region_validity(chart, u, q) and self.in_polytope(chart, u):
                return chart
        if len(self.charts) >= self.P.max_charts:
            return None
        J = self.world.jacobian(q)
        basis, _ = np.linalg.qr(J.T, mode="complete")
        self.charts.append(LiteralChart(q, basis[:, len(J) :], basis[:, : len(J)]))
        return self.charts[-1]


def continuation_walk(
    atlas: LiteralAtlas, lazy: bool, q_s: np.ndarray, q_e: np.ndarray, limit: int | None = None
) -> tuple[list, Stop]:
    """Algorithm 3, or with `lazy` Algorithm 4; returns the states and why it stopped."""
    world, P = atlas.world, atlas.P
    N = min(P.max_steps, limit or P.max_steps)
    states, D, d_w, q = [], 0.0, norm(q_e - q_s), q_s
    if d_w <= P.step:
        return finish(world, P, states, q_s, q_e)
    chart = atlas.get_chart(q)
    if chart is None:
        return states, Stop.NO_CHART
    u, u_e = chart.log(q), chart.log(q_e)
    while norm(u - u_e) > P.step:
        u = u + P.step * (u_e - u) / norm(u_e - u)
        following = chart.phi(u) if lazy else atlas.psi(chart, u, 3 * P.newton_steps)
        if following is None:
            return states, Stop.NOT_CONVERGED
        d = norm(following - q)
        D += d
        d1, d2 = norm(q - q_e), norm(following - q_e)
        stop = diverges(P, d1, d2, d, D, d_w, P.epsilon)
        if stop is None and not world.inside(following):
            stop = Stop.OUT_OF_BOUNDS
        if stop is not None:
            return states, stop
        chord, leaves = following, False
        if lazy:
            # Line 16: the distance of phi(u) to the manifold, to first order ||F||; and rho of eq. (5).
            leaves = norm(world.value(following)) > P.epsilon or norm(u) > P.rho
            if leaves:
                following = atlas.psi(chart, u, 3 * P.newton_steps)
                if following is None:
                    return states, Stop.NOT_CONVERGED
                if not world.inside(following):
                    return states, Stop.OUT_OF_BOUNDS
        else:
            leaves = not atlas.region_validity(chart, u, following) or not atlas.in_polytope(chart, u)
        if not way_is_free(world, P, q, chord) or not world.free(following):
            return states, Stop.COLLISION
        states.append(following)
        q = following
        if d2 <= P.step:
            return finish(world, P, states, q_s, q_e)
        if len(states) >= N:
            return states, Stop.STEP_LIMIT
        if leaves:
            chart = atlas.get_chart(q)
            if chart is None:
                return states, Stop.NO_CHART
            u, u_e = chart.log(q), chart.log(q_e)
    if norm(q - q_e) <= P.leap * P.step:  # over the target in the chart: a step from it, or on another fold
        return finish(world, P, states, q_s, q_e)
    return states, Stop.FOLDED
