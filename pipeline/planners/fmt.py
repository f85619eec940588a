"""FMT* (Janson et al. 2015) with continued sampling, as compnetx.txt, section VII-A, describes it.

The front is expanded in groups of nearly equal cost, as Group Marching Tree does (Ichter, Schmerling and Pavone 2017):
what is asked of many samples at once costs numpy little more than what is asked of one.

Edges are put into the tree by `Adherence.screen`; only those of a path that reaches the goal are walked. Where a walk
fails, its sample is hung onto another neighbour, and without one its branch is taken back and the search goes on.
"""

from dataclasses import dataclass
from itertools import compress, pairwise

import numpy as np

from pipeline.errors import ConfigError, require
from pipeline.manifolds import Adherence
from pipeline.planners.base import Clock, Planner, PlanStatus, Query, Termination
from pipeline.planners.tree import index
from pipeline.samplers.base import Sampler

_UNVISITED, _OPEN, _CLOSED = 0, 1, 2
_START, _GOAL = 0, 1
_BARREN = 100  # calls in a row without a free sample after which there is nothing to sample
_SHIFT = 32  # an edge is one number: sets of them are asked faster than sets of pairs
_MOST_LATE = 200_000  # neighbours of samples added at a time, between two looks at the clock: in 2 dimensions of 4000
_ALONG = 4  # edges that are asked for a sample at once: most fail, and further ones cost less than further calls
_ENTRIES = 1 << 16  # of tables of neighbours that are worked on between two looks at the clock: some milliseconds
_TRIES = 5  # neighbours that a sample whose edge did not hold is hung onto, before its branch is taken back


@dataclass(frozen=True)
class FmtStar(Planner):
    """A wavefront of least cost over a batch of samples; new samples join it when it dies out.

    Attributes:
        samples: N_init, size of the first batch with start and goal (1000: OMPL's default, used by the authors).
        radius_multiplier: eta of the number of neighbours (1.1: OMPL's default; asymptotic optimality needs 1).
        heuristic: order the front by cost so far plus the straight line to the goal, as A* does; OMPL has the same
            option, off by default.
        group: samples of the front that cost at most this much more than the cheapest are expanded with it, as a share
            of the neighbourhood's radius (median distance to the farthest neighbour); 0 is FMT*, one after the other.
        late: classical samples that are added at a time when the front has died out, as a share of those there are.
    """

    samples: int = 1000
    radius_multiplier: float = 1.1
    heuristic: bool = False
    group: float = 0.25
    late: float = 1.0

    def __post_init__(self) -> None:
        require("planner.samples", self.samples, at_least=3)  # start, goal and one more
        require("planner.radius_multiplier", self.radius_multiplier, above=0)
        require("planner.group", self.group, at_least=0)
        require("planner.late", self.late, at_least=0)

    def _prepare(self, space: Adherence) -> None:
        space.prepare_screen()

    def _search(
        self, query: Query, sampler: Sampler, termination: Termination, clock: Clock
    ) -> tuple[PlanStatus, np.ndarray | None]:
        if not sampler.lands:
            raise ConfigError("FMT* connects its samples: it needs a sampler that draws from the manifold")
        batch = self.first_batch(query, sampler, clock)
        wave = _Wave(query.adherence, batch, self.radius_multiplier, self.heuristic, self.group)
        while True:
            status = clock.tick()
            if status is not None:
                return status, None
            if wave.state[_GOAL] != _UNVISITED:
                path = wave.path()
                if path is not None:
                    return PlanStatus.SOLVED, path
            elif wave.alive:
                wave.advance()
            else:
                self._sample_again(query, sampler, wave, clock)

    def first_batch(self, query: Query, sampler: Sampler, clock: Clock) -> np.ndarray:
        """Return start, goal and N_init - 2 free samples, fewer when time runs out (N, n)."""
        space = query.adherence
        found = [query.start, query.goal]
        barren = 0
        while len(found) < self.samples and barren < _BARREN and not clock.out_of_time():
            proposals = sampler.cover(self.samples - len(found))
            free = space.free_rows(proposals)
            barren = 0 if free.any() else barren + 1
            found += list(proposals[free])
        return np.array(found[: self.samples])

    def _sample_again(self, query: Query, sampler: Sampler, wave: "_Wave", clock: Clock) -> None:
        """Sample from random tree nodes towards the goal until the tree has something to go on from (Algorithm 6)."""
        while not wave.alive and not clock.out_of_time():
            count = sampler.batch
            if not sampler.informed:  # from the whole manifold: many at once, and the front goes over them once
                count = max(count, min(int(self.late * wave.count), _MOST_LATE // wave.neighbours.shape[1]))
            tree = np.flatnonzero(wave.state == _CLOSED)
            current = wave.q[tree[sampler.rng.integers(len(tree), size=count)]]
            drawn = sampler.sample(current, np.repeat(query.goal[None], count, axis=0))
            free = drawn[query.adherence.free_rows(drawn)]
            if len(free):
                wave.extend(free)
            if clock.tick() is not None:
                return


class _Wave:
    """The sets of FMT*: unvisited, open (the front) and closed samples, with their tree."""

    def __init__(
        self, space: Adherence, batch: np.ndarray, radius_multiplier: float, heuristic: bool, group: float
    ) -> None:
        self.space = space
        self.radius_multiplier, self.heuristic, self.group = radius_multiplier, heuristic, group
        self.walks: dict[tuple[int, int], np.ndarray] = {}  # states of the edges that were walked and hold
        self.blocked: set[int] = set()  # edges, as parent << _SHIFT | sample
        self.q = np.empty((0, space.dimension))
        self.cost, self.reach = np.empty(0), np.empty(0)  # reach: the cost of open samples
        self.state, self.parent = np.empty(0, np.int8), np.empty(0, int)
        self._append(batch)
        self.cost[_START], self.state[_START], self.reach[_START] = 0.0, _OPEN, 0.0

    @property
    def count(self) -> int:
        """How many samples there are."""
        return len(self.q)

    @property
    def alive(self) -> bool:
        """True while there are open samples to go on from."""
        return bool(self.reach.min() < np.inf)

    def advance(self) -> None:
        """Expand the cheapest samples of the front: try each unvisited neighbour from its best open neighbour.

        Were they expanded one after the other, an unvisited sample would ask its best open neighbour again once the
        last one it asked has left the front. So it does here, as long as that one leaves with the group.
        """
        keys = self.reach + self.ahead if self.heuristic else self.reach
        group = np.flatnonzero(keys <= keys.min() + self.width)
        group = group[keys[group].argsort(kind="stable")]
        near = self.neighbours[group]
        rows, columns = np.nonzero(self.state[near] == _UNVISITED)
        rows, found = rows[::-1], near[rows, columns][::-1]  # the cheapest of the group come last, and stay
        asker = np.full(len(keys), -1)
        asker[found] = group[rows]
        waiting = np.flatnonzero(asker >= 0)
        joined = []
        most = max(_ENTRIES // near.shape[1], 1)
        for first in range(0, len(waiting), most):
            self.space.deadline.look()
            some = waiting[first : first + most]
            joined += self._join(group, some, asker[some], keys)
        self.state[group], self.reach[group] = _CLOSED, np.inf
        for edges in joined:
            self._hang(*edges)

    def _join(
        self, group: np.ndarray, waiting: np.ndarray, askers: np.ndarray, keys: np.ndarray
    ) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Return the edges by which waiting samples join the tree: parents, samples and lengths (m,), in parts.

        Args:
            group: samples that leave the front.
            waiting: unvisited samples (m,) with at least one of them for a neighbour.
            askers: the cheapest of those (m,).
            keys: by which the front is ordered, of all samples.
        """
        others = self.neighbours[waiting]  # (m, width)
        costs, places = self.reach[others] + self.distances[waiting], keys[others]
        left = np.arange(len(waiting))
        best = costs.argmin(axis=1)
        # Being among another's neighbours does not mean to have it among one's own.
        parents = np.where(costs[left, best] < np.inf, others[left, best], askers)
        leaving = np.zeros(self.count, bool)
        leaving[group] = True
        joined = []
        while len(left):
            tried, owners = [], []  # edges, and the rows of those they are for
            for _ in range(_ALONG):
                tried.append(parents[left])
                owners.append(left)
                left = left[leaving[parents[left]]]
                costs[left] = np.where(places[left] > keys[parents[left], None], costs[left], np.inf)
                best = costs[left].argmin(axis=1)
                parents[left] = others[left, best]
                left = left[leaving[parents[left]] & (costs[left, best] < np.inf)]
                if not len(left):
                    break
            asked, owner = np.concatenate(tried), np.concatenate(owners)
            holds, ways = self._connect(asked, waiting[owner])
            edge = np.full(len(waiting), -1)
            held = np.flatnonzero(holds)[::-1]  # the first of an owner comes last, and stays
            edge[owner[held]] = held
            found = edge[edge >= 0]
            joined.append((asked[found], waiting[owner[found]], ways[found]))
            left = left[edge[left] < 0]
        return joined

    def extend(self, Q: np.ndarray) -> None:
        """Add samples (m, n) and reopen the closed ones beside them: the front goes on from there."""
        old = self.count
        self._append(Q)
        beside = np.asarray((self.neighbours >= old).any(axis=1))
        beside[self.neighbours[old:]] = True
        again = np.flatnonzero(beside & (self.state == _CLOSED))
        self.state[again], self.reach[again] = _OPEN, self.cost[again]

    def _append(self, Q: np.ndarray) -> None:
        """Add unvisited samples (m, n), and find the neighbours of all."""
        new = len(Q)
        self.q = np.concatenate([self.q, Q])
        self.cost, self.reach = (np.append(values, np.full(new, np.inf)) for values in (self.cost, self.reach))
        self.state = np.append(self.state, np.full(new, _UNVISITED, np.int8))
        self.parent = np.append(self.parent, np.full(new, -1))
        self.ahead = self.space.apart(self.q - self.q[_GOAL])  # the straight line to the goal
        d = self.space.constraint.manifold_dimension
        # k-nearest FMT* as in OMPL: k = (2 eta)^d (e / d) log N, but d is the dimension of the manifold.
        k = max(int(np.ceil((2 * self.radius_multiplier) ** d * (np.e / d) * np.log(self.count))), 1)
        k = min(k + 1, self.count)
        distances, neighbours = np.empty((self.count, k)), np.empty((self.count, k), int)
        turns, most = self.space.turns, max(_ENTRIES // (8 * k), 1)
        tree, places = index(self.q, turns), self.q if turns is None else turns.folded(self.q)
        for first in range(0, self.count, most):
            self.space.deadline.look()
            rows = slice(first, first + most)
            found = tree.query(places[rows], k=k)
            distances[rows], neighbours[rows] = (part.reshape(-1, k) for part in found)
        self.space.counters.nearest_queries += self.count
        self.neighbours, self.distances = neighbours[:, 1:], distances[:, 1:]
        self.width = self.group * float(np.median(self.distances[:, -1]))

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
        self.blocked.add(int(self.parent[broken]) << _SHIFT | broken)
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

    def _connect(self, parents: np.ndarray, samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Tell which edges (parents[i], samples[i]) look free (m,), and how long those are; remember the others."""
        keys = (parents << _SHIFT | samples).tolist()
        unknown = [i for i, key in enumerate(keys) if key not in self.blocked]
        if len(unknown) == len(keys):
            holds, ways = self.space.screen(self.q[parents], self.q[samples])
        else:
            holds, ways = np.zeros(len(keys), bool), np.full(len(keys), np.inf)
            if unknown:
                holds[unknown], ways[unknown] = self.space.screen(self.q[parents[unknown]], self.q[samples[unknown]])
        self.blocked.update(compress(keys, (~holds).tolist()))
        return holds, ways

    def _hang(self, parents: np.ndarray, samples: np.ndarray, ways: np.ndarray) -> None:
        """Put samples into the tree, below parents by edges of these lengths, and into the front."""
        costs = self.cost[parents] + ways
        self.parent[samples], self.cost[samples] = parents, costs
        self.state[samples], self.reach[samples] = _OPEN, costs

    def _rewire(self, x: int) -> bool:
        """Hang x, whose edge failed, and all below it onto its next best neighbour, by an edge walked at once."""
        lost = self._below(x)
        near = self.neighbours[x]
        tree = near[(self.state[near] != _UNVISITED) & ~np.isin(near, lost)]
        order = tree[np.argsort(self.cost[tree] + self.space.apart(self.q[tree] - self.q[x]), kind="stable")]
        holds, ways = self._connect(order[:_TRIES], np.full(len(order[:_TRIES]), x))
        for y, way in zip(order[:_TRIES][holds].tolist(), ways[holds].tolist(), strict=True):
            walk = self.space.traverse(self.q[y], self.q[x])
            if not walk.reached:
                self.blocked.add(y << _SHIFT | x)
                continue
            self.walks[y, x] = walk.states
            self.parent[x] = y
            self.cost[lost] += self.cost[y] + way - self.cost[x]
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
        border = border[self.state[border] == _CLOSED]
        self.state[border], self.reach[border] = _OPEN, self.cost[border]

    def _below(self, x: int) -> np.ndarray:
        """Return x and all samples whose way to the start passes through it, sorted (m,)."""
        found = np.array([x])
        while True:
            grown = np.union1d(found, np.flatnonzero(np.isin(self.parent, found)))
            if len(grown) == len(found):
                return found
            found = grown
