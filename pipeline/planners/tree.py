"""A tree of configurations with the states of its edges."""

import numpy as np
from scipy.spatial import cKDTree

from pipeline.robots.turning import Turning

_TAIL = 256  # nodes looked at one by one: making a tree of them costs more


def index(Q: np.ndarray, turns: Turning | None) -> cKDTree:
    """Return the k-d tree of configurations Q (N, n); where joints turn it takes queries that are `folded`."""
    return cKDTree(Q) if turns is None else cKDTree(turns.folded(Q), boxsize=turns.periods)


class Tree:
    """Nodes on the manifold, each with the states walked from its parent. Removed nodes keep their index.

    With several roots it is a forest, whose paths begin at the root they come from.

    Nearest neighbours are found by looking at all of them: for the hundreds of nodes a bidirectional search needs this
    is faster than any structure (3 us for 500 nodes).

    Args:
        *roots: configurations (n,).
        turns: how to measure where joints turn.
    """

    def __init__(self, *roots: np.ndarray, turns: Turning | None = None) -> None:
        self.turns = turns
        self._q = np.empty((max(256, len(roots)), len(roots[0])))
        self._q[: len(roots)] = roots
        self.parents = [-1] * len(roots)
        self.edges: list[np.ndarray] = [np.empty((0, len(root))) for root in roots]
        self.children: list[list[int]] = [[] for _ in roots]
        self._index: cKDTree | None = None  # of the first nodes, see `nearest_of`
        self._rows, self._indexed = np.empty(0, int), 0

    def __len__(self) -> int:
        return len(self.parents)

    def __getitem__(self, node: int) -> np.ndarray:
        return self._q[node]

    def add(self, parent: int, states: np.ndarray) -> int:
        """Add a node at the last of `states` (T, n), walked from `parent`; return its index."""
        node = len(self.parents)
        if node == len(self._q):
            self._q = np.concatenate([self._q, np.empty_like(self._q)])
        self._q[node] = states[-1]
        self.parents.append(parent)
        self.edges.append(states)
        self.children.append([])
        self.children[parent].append(node)
        return node

    def nearest(self, q: np.ndarray) -> int:
        """Return the node nearest to q (n,) in the ambient space."""
        offsets = self._q[: len(self.parents)] - q
        if self.turns is not None:
            offsets = self.turns.wrapped(offsets)
        return int(np.einsum("ij,ij->i", offsets, offsets).argmin())

    def nearest_of(self, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the nodes nearest to rows of Q (m, n) in the ambient space (m,), and how far they are (m,).

        For trees of thousands of nodes: most of them sit in a k-d tree, which is made anew as they become more.
        """
        count = len(self.parents)
        if count > self._indexed + max(_TAIL, self._indexed // 8):
            rows = np.flatnonzero(np.isfinite(self._q[:count, 0]))  # without those removed
            self._index, self._rows, self._indexed = index(self._q[rows], self.turns), rows, count
        nodes, distances = np.zeros(len(Q), int), np.full(len(Q), np.inf)
        if self._index is not None:
            distances, found = self._index.query(Q if self.turns is None else self.turns.folded(Q))
            nodes = self._rows[found]
        if count > self._indexed:
            offsets = self._q[None, self._indexed : count] - Q[:, None]
            if self.turns is not None:
                offsets = self.turns.wrapped(offsets)
            squares = np.einsum("ijk,ijk->ij", offsets, offsets)
            nearer = np.sqrt(squares.min(axis=1)) < distances
            nodes = np.where(nearer, squares.argmin(axis=1) + self._indexed, nodes)
            distances = np.where(nearer, np.sqrt(squares.min(axis=1)), distances)
        return nodes, distances

    def path(self, node: int) -> tuple[np.ndarray, list[int]]:
        """Return the states from the root to `node` (T, n), and for each the node whose edge it is on."""
        nodes = [node]
        while self.parents[nodes[-1]] >= 0:
            nodes.append(self.parents[nodes[-1]])
        nodes.reverse()
        states = np.concatenate([self._q[nodes[:1]], *(self.edges[i] for i in nodes[1:])])
        owners = nodes[:1] + [i for i in nodes[1:] for _ in range(len(self.edges[i]))]
        return states, owners

    def remove(self, node: int) -> None:
        """Take `node` and all below it out of the tree: nothing is nearest to them any more."""
        self._index, self._rows, self._indexed = None, np.empty(0, int), 0
        waiting = [node]
        while waiting:
            i = waiting.pop()
            self._q[i] = np.inf
            waiting += self.children[i]
        self.children[self.parents[node]].remove(node)
