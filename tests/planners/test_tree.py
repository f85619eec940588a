"""A tree's neighbours, paths and removals are those of brute force over its edges."""

import numpy as np

from pipeline.planners.tree import Tree


def grow(rng: np.random.Generator, tree: Tree, count: int) -> None:
    """Add nodes below random ones that are still in the tree, with edges of one to four states."""
    for _ in range(count):
        alive = [i for i in range(len(tree)) if np.isfinite(tree[i]).all()]
        tree.add(int(rng.choice(alive)), rng.normal(size=(rng.integers(1, 5), 3)))


def test_nodes_are_the_last_states_of_their_edges():
    """Indices count up, also beyond the arrays first made; a node stands at its edge's last state."""
    rng, tree = np.random.default_rng(0), Tree(np.zeros(3))
    for expected in range(1, 700):
        parent, states = int(rng.integers(expected)), rng.normal(size=(2, 3))
        assert tree.add(parent, states) == expected and len(tree) == expected + 1
        np.testing.assert_array_equal(tree[expected], states[-1])
        assert tree.parents[expected] == parent and expected in tree.children[parent]
    np.testing.assert_array_equal(tree[0], np.zeros(3))


def test_nearest_is_brute_force():
    """The nearest node is the one of least distance, before and after branches are removed."""
    rng, tree = np.random.default_rng(1), Tree(np.zeros(3))
    grow(rng, tree, 400)
    for removed in (None, 20, 57, 140):
        if removed and np.isfinite(tree[removed]).all():
            tree.remove(removed)
        nodes = np.array([tree[i] for i in range(len(tree))])
        for q in rng.normal(size=(50, 3)):
            alive = np.flatnonzero(np.isfinite(nodes).all(axis=1))
            assert tree.nearest(q) == alive[np.linalg.norm(nodes[alive] - q, axis=1).argmin()]


def test_path_is_the_edges_from_the_root():
    """A path is the root and the edges down to the node; each state is owned by the node whose edge it is on."""
    rng, tree = np.random.default_rng(2), Tree(np.full(3, 9.0))
    grow(rng, tree, 60)
    for node in (0, 1, 30, 60):
        states, owners = tree.path(node)
        expected, i = [], node
        while i:
            expected = [(q, i) for q in tree.edges[i]] + expected
            i = tree.parents[i]
        expected = [(np.full(3, 9.0), 0), *expected]
        np.testing.assert_array_equal(states, [q for q, _ in expected])
        assert owners == [owner for _, owner in expected]


def test_removed_nodes_are_out_of_reach():
    """A removed node and all below it are nearest to nothing, even to where they stood; all others stay."""
    rng, tree = np.random.default_rng(3), Tree(np.zeros(3))
    grow(rng, tree, 150)
    before = [tree[i].copy() for i in range(len(tree))]
    node = next(i for i in range(1, 150) if len(tree.children[i]) > 2)
    below = {node}
    for i in range(node, len(tree)):  # children come after their parents
        if tree.parents[i] in below:
            below.add(i)
    tree.remove(node)
    assert 3 < len(below) < 150
    for i, q in enumerate(before):
        if i in below:
            assert tree.nearest(q) not in below
        else:
            assert tree.nearest(q) == i
            np.testing.assert_array_equal(tree[i], q)
            assert tree.path(i)[1][-1] == i and not below & set(tree.path(i)[1])
    assert all(node not in children for children in tree.children)
    assert tree.add(0, np.ones((1, 3))) == 151  # indices are not used again


def test_nearest_of_many_is_brute_force():
    """For batches of queries nodes and distances are those of brute force, as the tree grows and after removals."""
    rng, tree = np.random.default_rng(5), Tree(np.zeros(3))
    for round_ in range(8):
        grow(rng, tree, 150)
        if round_ == 5:
            tree.remove(int(rng.integers(1, 100)))
        Q = rng.normal(size=(40, 3))
        nodes, distances = tree.nearest_of(Q)
        everything = np.linalg.norm(np.array([tree[i] for i in range(len(tree))])[None] - Q[:, None], axis=2)
        np.testing.assert_array_equal(nodes, np.argmin(everything, axis=1))
        np.testing.assert_allclose(distances, np.nanmin(everything, axis=1))
