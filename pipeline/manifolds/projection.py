"""Projection-based adherence: Algorithm 2 of compnetx.txt, section II-B."""

import casadi as ca
import numpy as np

from pipeline.constraints import Constraint, Expressions
from pipeline.manifolds.base import Adherence, AdherenceParameters, Bounds, Stop, Traversal, first_code, length
from pipeline.robots import Validity


class ProjectionAdherence(Adherence):
    """Steps straight towards the target and projects every step.

    Algorithm 2 writes the step as gamma (q_e - q_i). Read literally its length shrinks with the distance and the bound
    d > lambda_1 gamma means nothing, so the step here has length gamma, as in Algorithms 3 and 4 and in OMPL.
    """

    def __init__(self, constraint: Constraint, validity: Validity, parameters: AdherenceParameters) -> None:
        super().__init__(constraint, validity, parameters)
        self._edge = self._compiled("projection_edge", self._edge_expressions)

    def _edge_expressions(self, bounds: Bounds) -> Expressions:
        constraint, parameters = self.constraint, self.parameters
        n, gamma, squared = constraint.n, parameters.step, bounds.squared
        x, target = ca.SX.sym("x", n), ca.SX.sym("target", n)
        way, longest = ca.SX.sym("way"), ca.SX.sym("longest")
        points, codes, ways, q, D = [], [], [], x, way
        for _ in range(parameters.lookahead):
            d1 = ca.norm_2(target - q)
            following, violation = constraint.projected(q + gamma * (target - q) / d1, parameters.newton_steps, squared)
            d = ca.norm_2(following - q)
            d2 = ca.norm_2(target - following)
            D = D + d
            converged = violation < squared
            codes.append(
                first_code(
                    [
                        (ca.logic_not(converged), Stop.NOT_CONVERGED),  # also for a NaN
                        (d2 > d1, Stop.AWAY),
                        (d > parameters.leap * gamma, Stop.LEAP),
                        (D > longest, Stop.WANDERED),
                        (ca.logic_not(bounds.inside(following)), Stop.OUT_OF_BOUNDS),
                        (d2 <= gamma, Stop.ARRIVED),
                    ]
                )
            )
            points += self._chord(q, following)
            ways.append(D)
            q = following
        results = [ca.horzcat(*points), ca.vertcat(*codes), ca.vertcat(*ways)]
        return Expressions([x, target, way, longest], results)

    def traverse(
        self, q_from: np.ndarray, q_to: np.ndarray, max_states: int | None = None, land: bool = True
    ) -> Traversal:
        """Walk by Algorithm 2."""
        self.counters.traversals += 1
        if self.turns is not None:
            q_to = self.turns.nearest(q_to, q_from)
        straight = length(q_to - q_from)
        reached: list[np.ndarray] = []
        limit = min(self.parameters.max_steps, max_states or self.parameters.max_steps)
        if straight <= self.parameters.step:
            return self._finish(reached, q_from, q_to, False, land)
        q, way, longest, covered = q_from, 0.0, self.parameters.wander * straight, False
        while True:
            self.deadline.look()
            flat, codes, ways = self._edge(q, q_to, way, longest)
            chords = flat.reshape(len(codes), -1, self.dimension).copy()
            for chord, code, total in zip(chords, codes.tolist(), ways.tolist(), strict=True):
                self.counters.projections += 1
                if code and code != Stop.ARRIVED.value:
                    return self._ended(reached, Stop(int(code)))
                passable, covered = self._passable(chord, total - way, covered)
                if not passable:
                    return self._ended(reached, Stop.COLLISION)
                way = total
                reached.append(chord[0])
                if code:
                    return self._finish(reached, q_from, q_to, covered, land)
                if len(reached) >= limit:
                    return self._ended(reached, Stop.STEP_LIMIT)
            q = chords[-1, 0]

    def sample(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Project uniform samples of the joint box (uniform there, not on the manifold)."""
        return self.project(rng.uniform(*self.validity.robot.box, (count, self.dimension)))
