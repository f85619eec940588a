"""RRTConnect (Kuffner and LaValle 2000), which with a moving-target sampler is Algorithm 7 of compnetx.txt."""

from dataclasses import dataclass

import numpy as np

from pipeline.errors import require
from pipeline.manifolds import Adherence
from pipeline.planners.base import Clock, Planner, PlanStatus, Query, Termination
from pipeline.planners.tree import Tree
from pipeline.samplers.base import Sampler


@dataclass(frozen=True)
class RrtConnect(Planner):
    """Two trees that grow towards samples and then towards each other.

    Attributes:
        range: longest extension towards a sample [rad or m]. Limiting it is what holds the tail of the planning times:
            an unlimited extension throws the tree across the manifold. Connections are not limited.
        node_states: every so many states of a walk become a node of the tree.
        balanced: grow the smaller tree towards the sample, instead of one after the other: a tree in a narrow place
            then does not fall behind (reports/performance.md, "What was tried").
        direct: begin with one walk from the start to the goal, which many problems of everyday need no more than; where
            the way is to be shorter than that, only the first search does.
        outward: share of the extensions towards a point in a random direction from a random node, instead of a sample.
            Where few random configurations reach the manifold within the limits (closed chains), samples leave most of
            it out, and wherever the obstacles are, they cost a projection.
        outward_distance: how far from that node these are, before they are clipped to the limits [rad or m].
    """

    range: float = 0.5
    node_states: int = 4
    balanced: bool = False
    direct: bool = False
    outward: float = 0.0
    outward_distance: float = 4.0

    def __post_init__(self) -> None:
        require("planner.range", self.range, above=0)
        require("planner.node_states", self.node_states, at_least=1)
        require("planner.outward", self.outward, at_least=0, at_most=1)
        require("planner.outward_distance", self.outward_distance, above=0)

    def _search(
        self, query: Query, sampler: Sampler, termination: Termination, clock: Clock
    ) -> tuple[PlanStatus, np.ndarray | None]:
        space = query.adherence
        longest = max(int(self.range / space.parameters.step), 1)
        trees = (Tree(*query.starts, turns=space.turns), Tree(*query.goals, turns=space.turns))
        current = [query.start, query.goal]  # the moving start and target of Algorithm 7
        if self.direct and not clock.iterations:  # a search anew would find the same path
            path = self._straight(space, trees, query.goal)
            if path is not None:
                return PlanStatus.SOLVED, path
        a, b = 0, 1
        while True:
            status = clock.tick()
            if status is not None:
                return status, None
            if self.balanced and len(trees[a]) > len(trees[b]):
                a, b = b, a
            outward = self._outward(space, trees[a], sampler.rng) if self.outward else None
            proposals = sampler.sample(current[a][None], current[b][None]) if outward is None else outward[None]
            if len(proposals):
                lands = sampler.lands and outward is None
                node, current[a], _ = self._grow(space, trees[a], proposals[0], longest, lands)
                if node is not None:
                    other, _, reached = self._grow(space, trees[b], current[a], None, True)
                    if reached and other is not None:
                        path = self._join(space, trees, (node, other) if a == 0 else (other, node))
                        if path is not None:
                            return PlanStatus.SOLVED, path
            a, b = b, a

    def _straight(self, space: Adherence, trees: tuple[Tree, Tree], goal: np.ndarray) -> np.ndarray | None:
        """Walk from the start to the goal; return the path if that arrives, and otherwise keep how far it came."""
        node, _, reached = self._grow(space, trees[0], goal, None, True)
        return self._join(space, trees, (node, 0)) if reached and node is not None else None

    def _outward(self, space: Adherence, tree: Tree, rng: np.random.Generator) -> np.ndarray | None:
        """Return a configuration (n,) to walk towards, in a random direction from a random node; now and then None.

        The walk begins at the node nearest to it, which is mostly another one.
        """
        centre = tree[int(rng.integers(len(tree)))]
        if rng.random() >= self.outward or not np.isfinite(centre[0]):  # a removed node
            return None
        direction = rng.normal(size=len(centre))
        return np.clip(centre + self.outward_distance / np.linalg.norm(direction) * direction, space.lower, space.upper)

    def _grow(
        self, space: Adherence, tree: Tree, target: np.ndarray, max_states: int | None, land: bool
    ) -> tuple[int | None, np.ndarray, bool]:
        """Walk from the nearest node towards `target`; return the new node, where that is, and if it is the target."""
        space.counters.nearest_queries += 1
        nearest = tree.nearest(target)
        walk = space.traverse(tree[nearest], target, max_states, land)
        if not len(walk.states):
            return None, tree[nearest].copy(), False
        return self._add(tree, nearest, walk.states), walk.states[-1], walk.reached

    def _add(self, tree: Tree, node: int, states: np.ndarray) -> int:
        """Add what was walked (T, n) from a node; return the last new node."""
        for first in range(0, len(states), self.node_states):
            node = tree.add(node, states[first : first + self.node_states])
        return node

    def _join(self, space: Adherence, trees: tuple[Tree, Tree], ends: tuple[int, int]) -> np.ndarray | None:
        """Return the path through two touching nodes if the finer walk holds; otherwise cut the tree where it fails."""
        forward, forward_owners = trees[0].path(ends[0])
        backward, backward_owners = trees[1].path(ends[1])
        refined = space.refine(np.concatenate([forward, backward[-2::-1]]))
        if refined.invalid is None:
            return refined.states
        space.counters.repairs += 1
        i = refined.invalid  # segment (i, i + 1)
        if i + 1 < len(forward):
            trees[0].remove(forward_owners[i + 1])
        else:  # in the second tree the segment belongs to the state farther from the goal
            trees[1].remove(backward_owners[len(backward) - 1 - (i - (len(forward) - 1))])
        return None
