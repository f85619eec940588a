"""A tree of configurations with the states of its edges."""

import numpy as np


class Tree:
    """Nodes on the manifold, each with the states walked from its parent. Removed nodes keep their index.

    Nearest neighbours are found by looking at all of them: for the hundreds of nodes a bidirectional search needs this
    is faster than any structure (3 us for 500 nodes).
    """

    def __init__(self, root: np.ndarray) -> None:
        self._q = np.empty((256, len(root)))
        self._q[0] = root
        self.parents = [-1]
        self.edges: list[np.ndarray] = [np.empty((0, len(root)))]
        self.children: list[list[int]] = [[]]

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

    def add_root(self, q: np.ndarray) -> None:
        """Add another root at q (n,): the tree becomes a forest, whose paths begin at the root they come from."""
        self.parents.append(-1)
        self.edges.append(np.empty((0, len(q))))
        self.children.append([])
        if len(self.parents) > len(self._q):
            self._q = np.concatenate([self._q, np.empty_like(self._q)])
        self._q[len(self.parents) - 1] = q

    def nearest(self, q: np.ndarray) -> int:
        """Return the node nearest to q (n,) in the ambient space."""
        offsets = self._q[: len(self.parents)] - q
        return int(np.einsum("ij,ij->i", offsets, offsets).argmin())

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
        waiting = [node]
        while waiting:
            i = waiting.pop()
            self._q[i] = np.inf
            waiting += self.children[i]
        self.children[self.parents[node]].remove(node)
