"""RRT (LaValle 1998): one tree from the start, K = 1 of Algorithm 6 of compnetx.txt with a learned sampler."""

from dataclasses import dataclass

import numpy as np

from pipeline.errors import require
from pipeline.planners.base import Clock, Planner, PlanStatus, Query, Termination
from pipeline.planners.tree import Tree
from pipeline.samplers.base import Sampler


@dataclass(frozen=True)
class Rrt(Planner):
    """A tree that grows towards samples, and now and then towards the goal.

    Attributes:
        range: longest extension [rad or m].
        goal_bias: probability of growing towards the goal (0.05: OMPL's default).
        node_states: every so many states of a walk become a node of the tree.
    """

    range: float = 1.0
    goal_bias: float = 0.05
    node_states: int = 4

    def __post_init__(self) -> None:
        require("planner.range", self.range, above=0)
        require("planner.goal_bias", self.goal_bias, above=0, at_most=1)
        require("planner.node_states", self.node_states, at_least=1)

    def _search(
        self, query: Query, sampler: Sampler, termination: Termination, clock: Clock
    ) -> tuple[PlanStatus, np.ndarray | None]:
        space, goal = query.adherence, query.goal
        longest = max(int(self.range / space.parameters.step), 1)
        tree = Tree(*query.starts, turns=space.turns)
        alive = list(range(len(tree)))
        while True:
            status = clock.tick()
            if status is not None:
                return status, None
            if sampler.rng.random() < self.goal_bias:
                targets = [goal]
            else:
                current = tree[alive[int(sampler.rng.integers(len(alive)))]]  # SelectNodes of Algorithm 6
                targets = list(sampler.sample(current[None], goal[None]))
            if not len(targets):
                continue
            space.counters.nearest_queries += 1
            node = tree.nearest(targets[0])
            walk = space.traverse(tree[node], targets[0], longest, sampler.lands or targets[0] is goal)
            for first in range(0, len(walk.states), self.node_states):
                node = tree.add(node, walk.states[first : first + self.node_states])
                alive.append(node)
            if walk.reached and targets[0] is goal:
                states, owners = tree.path(node)
                refined = space.refine(states)
                if refined.invalid is None:
                    return PlanStatus.SOLVED, refined.states
                space.counters.repairs += 1
                tree.remove(owners[refined.invalid + 1])
                alive = [i for i in alive if np.isfinite(tree[i][0])]
