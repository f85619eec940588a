"""FMT* (Janson et al. 2015) with continued sampling, as compnetx.txt, section VII-A, describes it."""

import heapq
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pipeline.errors import require
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
    """A wavefront of least cost over a batch of samples; new samples join one by one when it dies out.

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

    def _search(
        self, problem: Problem, sampler: Sampler, termination: Termination, clock: Clock
    ) -> tuple[PlanStatus, np.ndarray | None]:
        batch = self.first_batch(problem, sampler, clock)
        wave = _Wave(problem.adherence, batch, self.radius_multiplier, self.heuristic)
        while True:
            status = clock.tick()
            if status is not None:
                return status, None
            if wave.front:
                wave.advance()
            else:
                self._sample_again(problem, sampler, wave, clock)
            if wave.state[_GOAL] != _UNVISITED:
                path = wave.path()
                if path is not None:
                    return PlanStatus.SOLVED, path

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
            free = [space.validity.collision_free(q) for q in proposals]
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
            free = [q for q in space.sample(sampler.rng, count - len(found)) if space.validity.collision_free(q)]
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
            for q in sampler.sample(current, goals):
                if problem.adherence.validity.collision_free(q):
                    wave.join(q)
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
        # k-nearest FMT* as in OMPL: k = (2 eta)^d (e / d) log N, in the dimension of the manifold.
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
        self.edges: dict[int, np.ndarray] = {}
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
        joined = []
        if len(waiting):
            costs = self.reach[self.neighbours[waiting]] + self.distances[waiting]  # (m, width)
            best = costs.argmin(axis=1)
            rows = np.arange(len(waiting))
            # z has the sample among its neighbours, which does not mean that the sample has z among its own.
            parents = np.where(np.isfinite(costs[rows, best]), self.neighbours[waiting, best], z)
            joined = [x for _, x in self._connect(zip(parents.tolist(), waiting.tolist(), strict=True))]
        self.state[z], self.reach[z] = _CLOSED, np.inf
        for x in joined:
            self._open(x)

    def join(self, q: np.ndarray) -> bool:
        """Add a sample and connect it to the cheapest reachable closed neighbour; without one it stays unvisited."""
        offsets = self.q[: self.count] - q
        distances = np.sqrt(np.einsum("ij,ij->i", offsets, offsets))
        self.space.counters.nearest_queries += 1
        near = np.argpartition(distances, self.k)[: self.k] if self.k < self.count else np.arange(self.count)
        tree = near[self.state[near] == _CLOSED]
        if not len(tree):
            return False
        x = self._append(q, near, distances[near])
        order = tree[np.argsort(self.cost[tree] + distances[tree], kind="stable")][:_TRIES]
        for _ in self._connect((y, x) for y in order.tolist()):
            self._open(x)
            return True
        return False

    def path(self) -> np.ndarray | None:
        """Return the path to the goal if the finer walk holds; otherwise take the failing branch back."""
        nodes = [_GOAL]
        while nodes[-1] != _START:
            nodes.append(int(self.parent[nodes[-1]]))
        nodes.reverse()
        owners = [_START] + [i for i in nodes[1:] for _ in range(len(self.edges[i]))]
        refined = self.space.refine(np.concatenate([self.q[:1], *(self.edges[i] for i in nodes[1:])]))
        if refined.invalid is None:
            return refined.states
        self.space.counters.repairs += 1
        self._retract(owners[refined.invalid + 1])
        return None

    def _connect(self, edges: Iterable[tuple[int, int]]) -> Iterator[tuple[int, int]]:
        """Walk along edges (parent, sample) one by one and yield those that hold, each as soon as it is in the tree."""
        asked = [edge for edge in edges if edge not in self.blocked]
        if not asked:
            return
        worth = self.space.screen(*self.q[np.array(asked).T])
        for (y, x), promising in zip(asked, worth.tolist(), strict=True):
            walk = self.space.traverse(self.q[y], self.q[x]) if promising else None
            if walk is None or not walk.reached:
                self.blocked.add((y, x))
                continue
            self.parent[x] = y
            self.edges[x] = walk.states
            self.cost[x] = self.cost[y] + _way(self.q[y], walk.states)
            yield y, x

    def _open(self, x: int) -> None:
        self.state[x], self.reach[x] = _OPEN, self.cost[x]
        ahead = length(self.q[x] - self.q[_GOAL]) if self.heuristic else 0.0
        heapq.heappush(self.front, (float(self.cost[x]) + ahead, x))

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

    def _retract(self, node: int) -> None:
        """Block the edge to `node`, make it and all below it unvisited, and reopen what borders on them."""
        self.blocked.add((int(self.parent[node]), node))
        below = {node}
        grown = True
        while grown:
            children = {int(i) for i in np.flatnonzero(np.isin(self.parent[: self.count], list(below)))} - below
            below |= children
            grown = bool(children)
        lost = np.array(sorted(below))
        self.state[lost], self.reach[lost] = _UNVISITED, np.inf
        self.cost[lost], self.parent[lost] = np.inf, -1
        for i in below:
            self.edges.pop(i, None)
        border = np.unique(self.neighbours[lost])
        for i in border[(border >= 0) & (self.state[border] == _CLOSED)].tolist():
            self._open(i)


def _way(q: np.ndarray, states: np.ndarray) -> float:
    """Return the length of the way from q (n,) through states (T, n)."""
    steps = np.diff(states, axis=0, prepend=q[None])
    return float(np.sqrt(np.einsum("ij,ij->i", steps, steps)).sum())
