"""RRTConnect that looks where it has not been: dynamic domains (Yershova et al. 2005), no duplicates.

In a maze most uniform samples lie behind the walls of the nearest node, or where the trees are already. Both kinds are
told by a query of nearest nodes for a whole batch, at a hundredth of the price of a walk that fails. What is worth a
walk is mostly near the trees' ends, so samples are drawn around new nodes first. A tree that has stopped growing has
mostly missed a turn that is nearer to a node than those samples were: nodes are then looked around again, more closely.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.errors import require
from pipeline.manifolds import Adherence, Stop
from pipeline.planners.base import Clock, PlanStatus, Query, Termination
from pipeline.planners.rrtconnect import RrtConnect
from pipeline.planners.tree import Tree
from pipeline.samplers.base import Sampler

_WIDER, _NARROWER = 1.5, 0.5  # a domain after a walk that arrived, and after one that did not
_PATIENCE = 20  # batches without a sample to walk to, after which duplicates are held to half their distance
_AROUND = 8  # samples drawn around a new node
_OPEN = (Stop.REACHED, Stop.ARRIVED, Stop.STEP_LIMIT)


@dataclass(frozen=True)
class DynamicDomainRrtConnect(RrtConnect):
    """RRTConnect with a domain for every node: it is extended only towards samples that are nearer than that.

    Each new node has a few samples drawn around it, `domain` away; when all have, random nodes half as far away and the
    sampler take turns.

    Attributes:
        domain: of a node when a walk from it first failed; halves when one fails again, and grows when one arrives
            [rad or m]. Until then a node has the whole manifold.
        spacing: samples nearer than this to a node of the tree are duplicates [rad or m]; halves, and all domains are
            opened, when no sample is left.
        batch: samples drawn at a time, by the sampler or around nodes.
    """

    domain: float = 0.4
    spacing: float = 0.1
    batch: int = 256

    def __post_init__(self) -> None:
        super().__post_init__()
        require("planner.outward", self.outward, at_most=0)  # samples are drawn around nodes anyway
        require("planner.domain", self.domain, above=0)
        require("planner.spacing", self.spacing, above=0, below=self.domain)
        require("planner.batch", self.batch, at_least=_AROUND)

    def _search(
        self, query: Query, sampler: Sampler, termination: Termination, clock: Clock
    ) -> tuple[PlanStatus, np.ndarray | None]:
        space = query.adherence
        trees = (Tree(*query.starts, turns=space.turns), Tree(*query.goals, turns=space.turns))
        domains = (_Domains(self.domain), _Domains(self.domain))
        longest = max(int(self.range / space.parameters.step), 1)
        if self.direct and not clock.iterations:
            path = self._straight(space, trees, query.goal)
            if path is not None:
                return PlanStatus.SOLVED, path
        current = [query.start, query.goal]
        looked = [0, 0]  # nodes of each tree around which samples were drawn
        closely = [False, False]  # whether the last samples after that were drawn around nodes too
        spacing, barren, a, b = self.spacing, 0, 0, 1
        while True:
            if self.balanced and len(trees[a]) > len(trees[b]):
                a, b = b, a
            if looked[a] < len(trees[a]):
                nodes = np.arange(looked[a], min(looked[a] + self.batch // _AROUND, len(trees[a])))
                looked[a] += len(nodes)
                Q = self._around(space, trees[a], nodes, self.domain, sampler.rng)
            elif not closely[a]:
                closely[a] = True
                nodes = sampler.rng.integers(len(trees[a]), size=self.batch // _AROUND)
                Q = self._around(space, trees[a], nodes, self.domain / 2, sampler.rng)
            else:
                closely[a] = False
                rows = np.ones((self.batch, 1))
                Q = sampler.sample(rows * current[a], rows * current[b])
            taken: list[np.ndarray] = []
            for q, nearest in self._worthwhile(space, trees[a], domains[a], Q, spacing):
                status = clock.tick()
                if status is not None:
                    return status, None
                if not np.isfinite(trees[a][nearest][0]):
                    continue  # removed, by a path that failed since it was found nearest
                if taken and space.apart(np.array(taken) - q).min() < 2 * spacing:
                    continue  # the tree has just been there
                taken.append(q)
                node, _ = self._extend(space, trees[a], domains[a], nearest, q, longest, sampler.lands)
                if node is None:
                    continue
                current[a] = trees[a][node].copy()
                for target, near in self._worthwhile(space, trees[b], domains[b], current[a][None], 0.0):
                    other, reached = self._extend(space, trees[b], domains[b], near, target, None, True)
                    if reached and other is not None:
                        path = self._join(space, trees, (node, other) if a == 0 else (other, node))
                        if path is not None:
                            return PlanStatus.SOLVED, path
            barren = 0 if taken else barren + 1
            if barren == _PATIENCE:
                spacing, barren = spacing / 2, 0
                for each in domains:
                    each.open()
            status = clock.tick()
            if status is not None:
                return status, None
            a, b = b, a

    def _around(
        self, space: Adherence, tree: Tree, nodes: np.ndarray, far: float, rng: np.random.Generator
    ) -> np.ndarray:
        """Return samples of the manifold (m, n) about `far` away from nodes (k,)."""
        centres = np.array([tree[node] for node in nodes.tolist()])
        centres = np.repeat(centres[np.isfinite(centres[:, 0])], _AROUND, axis=0)  # without those removed
        offsets = rng.normal(size=centres.shape)
        return space.project(centres + far * offsets / np.linalg.norm(offsets, axis=1, keepdims=True))

    def _worthwhile(
        self, space: Adherence, tree: Tree, domains: "_Domains", Q: np.ndarray, spacing: float
    ) -> list[tuple[np.ndarray, int]]:
        """Return the samples (n,) that are new and within the domain of their nearest node, with that."""
        if not len(Q):
            return []
        space.counters.nearest_queries += len(Q)
        nodes, distances = tree.nearest_of(Q)
        kept = np.flatnonzero((distances > spacing) & (distances < domains.of(nodes)))
        return [(Q[i], int(nodes[i])) for i in kept]

    def _extend(
        self,
        space: Adherence,
        tree: Tree,
        domains: "_Domains",
        node: int,
        target: np.ndarray,
        most: int | None,
        land: bool,
    ) -> tuple[int | None, bool]:
        """Walk from a node towards `target`, remember how that went; return the last new node, if it is the target."""
        walk = space.traverse(tree[node], target, most, land)
        domains.learn(node, walk.stop in _OPEN)
        return (self._add(tree, node, walk.states), walk.reached) if len(walk.states) else (None, False)


class _Domains:
    """Radii by node; those that no walk has failed from are open."""

    def __init__(self, first: float) -> None:
        self.first = first
        self._radii: dict[int, float] = {}

    def of(self, nodes: np.ndarray) -> np.ndarray:
        """Return the radii of nodes (m,)."""
        radii = self._radii
        return np.array([radii.get(node, np.inf) for node in nodes.tolist()])

    def learn(self, node: int, arrived: bool) -> None:
        """Widen or narrow a node's domain."""
        radius = self._radii.get(node, np.inf)
        if arrived:
            if radius < np.inf:
                self._radii[node] = radius * _WIDER
        else:
            self._radii[node] = radius * _NARROWER if radius < np.inf else self.first

    def open(self) -> None:
        """Forget what was learned."""
        self._radii.clear()
