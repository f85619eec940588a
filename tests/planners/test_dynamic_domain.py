"""RRTConnect with dynamic domains: radii learn from walks, bounds are kept, and what is solved is verified."""

import numpy as np
import pytest

from pipeline.environments.torus import Mazes
from pipeline.errors import ConfigError
from pipeline.manifolds import make_adherence
from pipeline.planners import DynamicDomainRrtConnect, PlanStatus, Query, RrtConnect, Termination
from pipeline.planners.dynamic_domain import _Domains
from pipeline.samplers import UniformSampler
from pipeline.schema import Choice
from pipeline.tasks import build
from pipeline.verification.judge import Judge


def test_domains_learn():
    """A node is open until a walk from it fails; then its radius halves at failures and grows at successes."""
    domains = _Domains(0.4)
    nodes = np.array([3, 5])
    assert np.isinf(domains.of(nodes)).all()
    domains.learn(3, True)
    assert np.isinf(domains.of(nodes)).all()
    domains.learn(3, False)
    assert domains.of(nodes).tolist() == [0.4, np.inf]
    domains.learn(3, False)
    assert domains.of(nodes)[0] == pytest.approx(0.2)
    domains.learn(3, True)
    assert domains.of(nodes)[0] == pytest.approx(0.3)
    domains.open()
    assert np.isinf(domains.of(nodes)).all()


def asked(rows: int, columns: int, seed: int, method: str = "projection") -> Query:
    """A maze whose walks cut no corner."""
    task = build(Mazes(rows, columns).task(5, seed).leg)
    margin = 0.25 * task.conditions[0].pixel_size
    choice = Choice(method, {"step": max(0.05, 2 * margin), "resolution": 2 * margin})
    return Query(make_adherence(choice, task.constraint, task.validity(margin)), task.start, task.goal)


def verified(rows: int, columns: int, seed: int, path: np.ndarray) -> bool:
    """The verdict on a path through a maze of `asked`."""
    task = build(Mazes(rows, columns).task(5, seed).leg)
    return Judge(task.statement).verify(path, task.start, task.goal).passed


def test_fewer_walks_than_without():
    """A maze of 60 cells takes less than half of the walks that RRTConnect takes, and the path is verified."""
    problem = asked(6, 10, 0)
    planner = DynamicDomainRrtConnect(node_states=1, balanced=True, domain=0.6, spacing=0.15)
    found = planner.plan(problem, UniformSampler(), Termination(max_iterations=50_000), 0)
    usual = RrtConnect(node_states=1, balanced=True).plan(
        problem, UniformSampler(), Termination(max_iterations=20_000), 0
    )
    assert found.solved and found.counters.traversals < usual.counters.traversals / 2
    assert verified(6, 10, 0, found.path)


@pytest.mark.parametrize("method", ["projection", "atlas", "tangent_bundle"])
def test_every_adherence_method_gets_through(method):
    """A maze of 24 cells is solved by each of the three methods, and the path passes the verifier."""
    planner = DynamicDomainRrtConnect(node_states=1, balanced=True, domain=0.9, spacing=0.2)
    found = planner.plan(asked(4, 6, 3, method), UniformSampler(), Termination(max_iterations=50_000), 0)
    assert found.solved and verified(4, 6, 3, found.path)


def test_stalled_trees_look_more_closely(monkeypatch):
    """Around new nodes a tree looks a domain away; once it has, random nodes half as far and the sampler take turns."""
    far, draws = [], []
    around, sample = DynamicDomainRrtConnect._around, UniformSampler.sample

    def looked(self, space, tree, nodes, distance, rng):
        far.append(distance)
        return around(self, space, tree, nodes, distance, rng)

    def drawn(self, *where):
        draws.append(len(far))
        return sample(self, *where)

    monkeypatch.setattr(DynamicDomainRrtConnect, "_around", looked)
    monkeypatch.setattr(UniformSampler, "sample", drawn)
    planner = DynamicDomainRrtConnect(node_states=1, balanced=True, domain=0.5, spacing=0.45)
    planner.plan(asked(4, 6, 1), UniformSampler(), Termination(max_iterations=3000), 0)
    assert far[0] == 0.5 and set(far) == {0.5, 0.25}
    closely = far.count(0.25)
    assert len(draws) > 1 and abs(closely - len(draws)) <= 2  # by turns, of each of the two trees


def test_the_same_seed_is_the_same_path():
    """Two plans with one seed give the same path to the bit; another seed another one."""
    planner = DynamicDomainRrtConnect(node_states=1, balanced=True, domain=0.9, spacing=0.2)
    paths = [
        planner.plan(asked(4, 6, 1), UniformSampler(), Termination(max_iterations=50_000), s).path for s in (3, 3, 4)
    ]
    np.testing.assert_array_equal(paths[0], paths[1])
    assert len(paths[0]) and not np.array_equal(paths[0], paths[2])


def test_limits_end_it():
    """Iterations and time end a search that has not arrived, and the result says which."""
    planner = DynamicDomainRrtConnect(domain=0.2, spacing=0.06)
    for termination, status in (
        (Termination(max_iterations=30), PlanStatus.ITERATION_LIMIT),
        (Termination(time_limit=0.02), PlanStatus.TIME_LIMIT),
    ):
        result = planner.plan(asked(15, 25, 2), UniformSampler(), termination, 0)
        assert result.status is status and not len(result.path)


def test_bad_settings():
    """A spacing that leaves no domain, and batches too small to look around a node, are refused."""
    for changes, message in (
        ({"domain": 0.0}, "domain is 0.0"),
        ({"spacing": 0.5}, "spacing is 0.5"),
        ({"batch": 4}, "batch is 4"),
    ):
        with pytest.raises(ConfigError, match=message):
            DynamicDomainRrtConnect(**changes)
