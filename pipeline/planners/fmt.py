"""FMT* (Janson et al. 2015) with continued sampling, as compnetx.txt, section VII-A, describes it.

Edges are put into the tree by `Adherence.screen`; only those of a path that reaches the goal are walked. Where a walk
fails, its sample is hung onto another neighbour, and without one its branch is taken back and the search goes on.
"""

import heapq
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from pipeline.errors import ConfigError, require
from pipeline.manifolds import Adherence
from pipeline.manifolds.base import length
from pipeline.planners.base import Clock, Planner, PlanStatus, Problem, Termination
from pipeline.samplers.base import Sampler

_UNVISITED, _OPEN, _CLOSED = 0, 1, 2
_START, _GOAL = 0, 1
_BARREN = 100  # calls in a row without a free sample after which there is nothing to sample
_TRIES = 5  # neighbours a late sample tries before it is left for the wave: most of the dear ones are blocked too


@dataclass(frozen=True)
class FmtStar(Planner):
    """A wavefront of least cost over a batch of samples; new samples join it when it dies out.

    Attributes:
        samples: N_init, size of the first batch with start and goal (1000: OMPL's default, used by the authors).
        radius_multiplier: eta of the number of neighbours (1.1: OMPL's default; asymptotic optimality needs 1).
        heuristic: order the front by cost so far plus the straight line to the goal, as A* does; OMPL has the same
            option, off by default.
        from_start: share of the first K learned samples that continue from the start; the others continue from
            random free configurations. Section V-E names both, section VII-A the second.
        arrive: a chain of learned samples within this of the goal begins again at a random free configuration
            [rad or m]: otherwise the batch ends up as a cluster around the goal.
    """

    samples: int = 1000
    radius_multiplier: float = 1.1
    heuristic: bool = False
    from_start: float = 0.5
    arrive: float = 0.1

    def __post_init__(self) -> None:
        require("planner.samples", self.samples, at_least=3)  # start, goal and one more
        require("planner.radius_multiplier", self.radius_multiplier, above=0)
        require("planner.from_start", self.from_start, at_least=0, at_most=1)
        require("planner.arrive", self.arrive, at_least=0)

    def _prepare(self, space: Adherence) -> None:
        space.prepare_screen()

    def _search(
        self, problem: Problem, sampler: Sampler, termination: Termination, clock: Clock
    ) -> tuple[PlanStatus, np.ndarray | None]:
        if not sampler.lands:
            raise ConfigError("FMT* connects its samples: it needs a sampler that draws from the manifold")
        batch = self.first_batch(problem, sampler, clock)
        wave = _Wave(problem.adherence, batch, self.radius_multiplier, self.heuristic)
        while True:
            status = clock.tick()
            if status is not None:
                return status, None
            if wave.state[_GOAL] != _UNVISITED:
                path = wave.path()
                if path is not None:
                    return PlanStatus.SOLVED, path
            elif wave.front:
                wave.advance()
            else:
                self._sample_again(problem, sampler, wave, clock)

    def first_batch(self, problem: Problem, sampler: Sampler, clock: Clock) -> np.ndarray:
        """Return start, goal and N_init - 2 free samples, fewer when time runs out (N, n)."""
        space, K = problem.adherence, sampler.batch
        found = [problem.start, problem.goal]
        goals = np.repeat(problem.goal[None], K, axis=0)
        current = goals
        if sampler.informed:
            current = np.repeat(problem.start[None], K, axis=0)
            first = round(self.from_start * K)
            spread = self._random_free(space, sampler, K - first, clock)
            current[first : first + len(spread)] = spread
        barren = 0
        while len(found) < self.samples and barren < _BARREN and not clock.out_of_time():
            proposals = sampler.sample(current, goals)
            free = [space.validity.free(q) for q in proposals]
            barren = 0 if any(free) else barren + 1
            found += [q for q, is_free in zip(proposals, free, strict=True) if is_free]
            if sampler.informed:
                onward = np.array(free, bool) & (np.linalg.norm(proposals - problem.goal, axis=1) > self.arrive)
                kept = proposals[onward] if len(proposals) else np.empty((0, space.dimension))
                current = np.concatenate([kept, self._random_free(space, sampler, K - len(kept), clock)])
                if len(current) < K:
                    current = np.concatenate([current, np.repeat(problem.start[None], K - len(current), axis=0)])
        return np.array(found[: self.samples])

    def _random_free(self, space: Adherence, sampler: Sampler, count: int, clock: Clock) -> np.ndarray:
        """Return up to `count` free configurations spread over the manifold (m, n)."""
        found: list[np.ndarray] = []
        barren = 0
        while len(found) < count and barren < _BARREN and not clock.out_of_time():
            free = [q for q in space.sample(sampler.rng, count - len(found)) if space.validity.free(q)]
            barren = 0 if free else barren + 1
            found += free
        return np.array(found).reshape(-1, space.dimension)

    def _sample_again(self, problem: Problem, sampler: Sampler, wave: "_Wave", clock: Clock) -> None:
        """Sample from random tree nodes towards the goal until a sample joins the tree (Algorithm 6)."""
        K = sampler.batch if sampler.informed else 1
        goals = np.repeat(problem.goal[None], K, axis=0)
        while not wave.front and not clock.out_of_time():
            tree = np.flatnonzero(wave.state[: wave.count] == _CLOSED)
            current = wave.q[tree[sampler.rng.integers(len(tree), size=K)]]
            free = [q for q in sampler.sample(current, goals) if problem.adherence.validity.free(q)]
            if free:
                wave.join(np.array(free))
            if clock.tick() is not None:
                return


class _Wave:
    """The sets of FMT*: unvisited, open (the front) and closed samples, with their tree.

    Neighbours stand in rows of equal width, filled up with -1: the last entry of `state` and `reach`, no sample,
    answers for it.
    """

    def __init__(self, space: Adherence, batch: np.ndarray, radius_multiplier: float, heuristic: bool) -> None:
        self.space = space
        self.count = len(batch)
        self.heuristic = heuristic
        self.q = batch
        d = space.constraint.manifold_dimension
        # k-nearest FMT* as in OMPL: k = (2 eta)^d (e / d) log N, but d is the dimension of the manifold.
        self.k = max(int(np.ceil((2 * radius_multiplier) ** d * (np.e / d) * np.log(self.count))), 1)
        k = min(self.k + 1, self.count)
        distances, neighbours = cKDTree(batch).query(batch, k=k)
        space.counters.nearest_queries += self.count
        self.neighbours = neighbours.reshape(self.count, -1)[:, 1:]
        self.distances = distances.reshape(self.count, -1)[:, 1:]
        self.degree = np.full(self.count, k - 1)
        self.cost = np.full(self.count, np.inf)
        self.state = np.full(self.count + 1, _UNVISITED, np.int8)
        self.state[-1] = _CLOSED
        self.reach = np.full(self.count + 1, np.inf)  # the cost of open samples
        self.parent = np.full(self.count, -1)
        self.walks: dict[tuple[int, int], np.ndarray] = {}  # states of the edges that were walked and hold
        self.blocked: set[tuple[int, int]] = set()
        self.front: list[tuple[float, int]] = []
        self.cost[_START] = 0.0
        self._open(_START)

    def advance(self) -> None:
        """Expand the cheapest sample of the front: try each unvisited neighbour from its best open neighbour."""
        _, z = heapq.heappop(self.front)
        if self.state[z] != _OPEN:
            return  # an entry left behind by a repair
        near = self.neighbours[z]
        waiting = near[self.state[near] == _UNVISITED]
        joined: list[tuple[int, int, float]] = []
        if len(waiting):
            others = self.neighbours[waiting]  # (m, width)
            costs = self.reach[others] + self.distances[waiting]
            best = costs.argmin(axis=1)
            rows = np.arange(len(waiting))
            # z has the sample among its neighbours, which does not mean that the sample has z among its own.
            parents = np.where(np.isfinite(costs[rows, best]), others[rows, best], z)
            joined = self._connect(parents, waiting)
        self.state[z], self.reach[z] = _CLOSED, np.inf
        for edge in joined:
            self._hang(*edge)

    def join(self, Q: np.ndarray) -> None:
        """Add samples (m, n) and connect each to its cheapest reachable closed neighbour.

        The tree is the same as if they came one by one: a sample knows those before it, but is not connected to them.
        One without a closed neighbour is left out; one that can reach none of them stays unvisited.
        """
        distances = cdist(Q, self.q[: self.count])
        self.space.counters.nearest_queries += len(Q)
        near = self._nearest(distances)
        beside = (self.state[near] == _CLOSED).any(axis=1)
        if not beside.any():
            return
        Q, distances, near = Q[beside], distances[beside], near[beside]
        if len(Q) > 1:
            others = cdist(Q, Q)
            others[np.triu_indices(len(Q))] = np.inf
            distances = np.concatenate([distances, others], axis=1)
            near = self._nearest(distances)
        distances = np.take_along_axis(distances, near, axis=1)
        samples = np.array([self._append(*row) for row in zip(Q, near, distances, strict=True)])
        costs = np.where(self.state[near] == _CLOSED, self.cost[near] + distances, np.inf)
        order = np.argsort(costs, axis=1, kind="stable")[:, :_TRIES]
        parents, reachable = np.take_along_axis(near, order, axis=1), np.take_along_axis(costs, order, axis=1) < np.inf
        for tries in (slice(0, 1), slice(1, _TRIES)):  # the cheapest first: it often holds
            left = self.state[samples] == _UNVISITED
            asked = reachable[left, tries]
            edges = parents[left, tries][asked], np.repeat(samples[left], asked.sum(axis=1))
            for parent, x, way in self._connect(*edges):
                if self.state[x] == _UNVISITED:
                    self._hang(parent, x, way)

    def _nearest(self, distances: np.ndarray) -> np.ndarray:
        """Return the columns of the k least entries in each row of distances (m, N)."""
        if self.k >= distances.shape[1]:
            return np.repeat(np.arange(distances.shape[1])[None], len(distances), axis=0)
        return np.argpartition(distances, self.k, axis=1)[:, : self.k]

    def path(self) -> np.ndarray | None:
        """Walk along the tree to the goal; return the path if all of it holds, else mend the tree where it fails."""
        nodes = [_GOAL]
        while nodes[-1] != _START:
            nodes.append(int(self.parent[nodes[-1]]))
        nodes.reverse()
        broken, states = self._follow(nodes)
        if broken is None:
            return states
        self.space.counters.repairs += 1
        self.blocked.add((int(self.parent[broken]), broken))
        if not self._rewire(broken):
            self._retract(broken)
        return None

    def _follow(self, nodes: list[int]) -> tuple[int | None, np.ndarray]:
        """Walk from node to node; return the first whose edge fails, None when all hold, and the states (T, n)."""
        for y, x in pairwise(nodes):
            if (y, x) not in self.walks:
                walk = self.space.traverse(self.q[y], self.q[x])
                if not walk.reached:
                    return x, walk.states
                self.walks[y, x] = walk.states
        ways = [self.walks[edge] for edge in pairwise(nodes)]
        owners = [x for x, way in zip(nodes[1:], ways, strict=True) for _ in way]
        refined = self.space.refine(np.concatenate([self.q[:1], *ways]))
        return None if refined.invalid is None else owners[refined.invalid], refined.states

    def _connect(self, parents: np.ndarray, samples: np.ndarray) -> list[tuple[int, int, float]]:
        """Return those edges (parents[i], samples[i]) that look free, with their lengths; remember the others."""
        edges = list(zip(parents.tolist(), samples.tolist(), strict=True))
        unknown = [i for i, edge in enumerate(edges) if edge not in self.blocked]
        if not unknown:
            return []
        if len(unknown) < len(edges):
            parents, samples, edges = parents[unknown], samples[unknown], [edges[i] for i in unknown]
        promising, lengths = self.space.screen(self.q[parents], self.q[samples])
        found = []
        for edge, holds, way in zip(edges, promising.tolist(), lengths.tolist(), strict=True):
            if holds:
                found.append((*edge, way))
            else:
                self.blocked.add(edge)
        return found

    def _hang(self, parent: int, x: int, way: float) -> None:
        """Put x into the tree, below `parent` by an edge of length `way`, and into the front."""
        self.parent[x], self.cost[x] = parent, self.cost[parent] + way
        self._open(x)

    def _open(self, x: int) -> None:
        cost = float(self.cost[x])
        self.state[x], self.reach[x] = _OPEN, cost
        ahead = length(self.q[x] - self.q[_GOAL]) if self.heuristic else 0.0
        heapq.heappush(self.front, (cost + ahead, x))

    def _append(self, q: np.ndarray, near: np.ndarray, distances: np.ndarray) -> int:
        x = self.count
        width = max(len(near), int(self.degree[near].max()) + 1)
        if x == len(self.cost) or width > self.neighbours.shape[1]:
            self._grow(2 * x if x == len(self.cost) else len(self.cost), width)
        self.q[x] = q
        self.neighbours[x, : len(near)], self.distances[x, : len(near)] = near, distances
        column = self.degree[near]
        self.neighbours[near, column], self.distances[near, column] = x, distances
        self.degree[near] += 1
        self.degree[x] = len(near)
        self.count += 1
        return x

    def _grow(self, rows: int, width: int) -> None:
        """Make room for `rows` samples of `width` neighbours."""
        old = len(self.cost)
        shape = (rows, max(width + self.k, self.neighbours.shape[1]))
        for name, empty in (("neighbours", -1), ("distances", np.inf)):
            before = getattr(self, name)
            table = np.full(shape, empty, before.dtype)
            table[: len(before), : before.shape[1]] = before
            setattr(self, name, table)
        for name, empty, spare in (
            ("q", 0.0, 0),
            ("degree", 0, 0),
            ("cost", np.inf, 0),
            ("parent", -1, 0),
            ("state", _UNVISITED, 1),
            ("reach", np.inf, 1),
        ):
            before = getattr(self, name)
            longer = np.full((rows + spare, *before.shape[1:]), empty, before.dtype)
            longer[:old] = before[:old]
            setattr(self, name, longer)
        self.state[-1] = _CLOSED

    def _rewire(self, x: int) -> bool:
        """Hang x, whose edge failed, and all below it onto its next best neighbour, by an edge walked at once."""
        lost = self._below(x)
        near = self.neighbours[x]
        tree = near[(near >= 0) & (self.state[near] != _UNVISITED) & ~np.isin(near, lost)]
        order = tree[np.argsort(self.cost[tree] + np.linalg.norm(self.q[tree] - self.q[x], axis=1), kind="stable")]
        asked = [(y, x) for y in order[:_TRIES].tolist() if (y, x) not in self.blocked]
        if not asked:
            return False
        promising, lengths = self.space.screen(*self.q[np.array(asked).T])
        for (y, _), holds, way in zip(asked, promising.tolist(), lengths.tolist(), strict=True):
            walk = self.space.traverse(self.q[y], self.q[x]) if holds else None
            if walk is None or not walk.reached:
                self.blocked.add((y, x))
                continue
            self.walks[y, x] = walk.states
            self.parent[x] = y
            self.cost[lost] += self.cost[y] + way - self.cost[x]
            # Their places in the front stay, by the old cost: they may be expanded a little early.
            ahead = lost[self.state[lost] == _OPEN]
            self.reach[ahead] = self.cost[ahead]
            return True
        return False

    def _retract(self, x: int) -> None:
        """Make x and all below it unvisited, and reopen what borders on them."""
        lost = self._below(x)
        self.state[lost], self.reach[lost] = _UNVISITED, np.inf
        self.cost[lost], self.parent[lost] = np.inf, -1
        border = np.unique(self.neighbours[lost])
        for i in border[(border >= 0) & (self.state[border] == _CLOSED)].tolist():
            self._open(i)

    def _below(self, x: int) -> np.ndarray:
        """Return x and all samples whose way to the start passes through it, sorted (m,)."""
        found = np.array([x])
        while True:
            grown = np.union1d(found, np.flatnonzero(np.isin(self.parent[: self.count], found)))
            if len(grown) == len(found):
                return found
            found = grown
