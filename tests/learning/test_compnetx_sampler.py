"""The CoMPNetX sampler brings the network's proposals onto the manifold and gives way to the classical sampler."""

from itertools import pairwise

import numpy as np
import pytest
import torch

from pipeline.errors import ArtifactError, ConfigError, ProblemError
from pipeline.learning.choices import Learned, make_sampler
from pipeline.learning.compnetx import CompnetxNetwork, CompnetxParameters, CompnetxSampler, Layers, untrained
from pipeline.learning.task_kinds import task_kinds
from pipeline.manifolds import Adherence
from pipeline.samplers import Asked, Sampler, UniformSampler
from pipeline.schema import Choice
from tests.manifolds.spaces import METHODS, sphere_space
from tests.robots.worlds import on_sphere

VOXELS = {name: np.random.default_rng(i).random((11, 11, 11)) < 0.3 for i, name in enumerate(("kitchen", "bar"))}


@pytest.fixture(scope="module")
def network() -> CompnetxNetwork:
    """An untrained network whose answers are spread over the whole cube and beyond."""
    space = sphere_space("projection")
    kinds = task_kinds([(space.validity.robot, space.constraint)], centre=False)
    model = untrained(Layers(scene_hidden=8, scene_code=8, hidden=(16, 8), dropout_layers=2), kinds, 11, 0)
    with torch.no_grad():
        model.network.generator.output.weight *= 8
    return CompnetxNetwork(model)


def started(network, method="projection", seed=0, scene="kitchen", upper=(1.5,) * 3, **parameters) -> CompnetxSampler:
    sampler = CompnetxSampler(network, VOXELS, CompnetxParameters(**parameters))
    return bound(sampler, begun(method, upper=upper), seed, scene)


def bound(sampler: Sampler, space: Adherence, seed: int, scene: str | None = "kitchen") -> Sampler:
    """Bind to a way from one pole to the other."""
    sampler.begin(Asked(space, np.eye(3)[0], np.eye(3)[2], scene), np.random.default_rng(seed))
    return sampler


def answers(network, sampler, monkeypatch) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """What the network is asked from now on, and what it answers, as (current, target, proposals)."""
    found, real = [], network.sample

    def sample(scene, current, target, rng):
        found.append((current.copy(), target.copy(), real(scene, current, target, rng)))
        return found[-1][2]

    monkeypatch.setattr(network, "sample", sample)
    return found


def begun(method: str, **settings) -> Adherence:
    space = sphere_space(method, **settings)
    space.anchor(np.array([1.0, 0.0, 0.0]))
    return space


def ask(sampler: Sampler, count: int, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return sampler.sample(on_sphere(rng, count), on_sphere(rng, count))


@pytest.mark.parametrize("method", METHODS)
def test_samples_are_on_the_manifold_within_bounds(network, method):
    """Samples lie on the sphere and below a ceiling that cuts it; proposals beyond are dropped, the rest is counted."""
    sampler = started(network, method, upper=(1.5, 1.5, 0.2))
    found = [ask(sampler, 20, seed) for seed in range(10)]
    together = np.concatenate(found)
    assert np.abs(np.linalg.norm(together, axis=1) - 1).max() < 1e-3
    assert together[:, 2].max() <= 0.2
    assert all(len(samples) <= 20 for samples in found) and 20 < len(together) < 200
    counters = sampler.counters
    assert (counters.samples, counters.fallback_samples) == (len(together), 0)
    assert (counters.network_calls, counters.projections) == (10, 200)


def test_samples_are_the_projected_proposals(network):
    """A sample is the point of the sphere in the direction of the network's proposal for the same pair and stream."""
    sampler = started(network, seed=4)
    found = ask(sampler, 20)
    rng = np.random.default_rng(1)
    proposals = network.sample(sampler.first.key, on_sphere(rng, 20), on_sphere(rng, 20), np.random.default_rng(4))
    assert np.linalg.norm(proposals, axis=1).std() > 0.1
    np.testing.assert_allclose(found, proposals / np.linalg.norm(proposals, axis=1)[:, None], atol=1e-3)


def test_chains_go_on_from_the_proposals(network, monkeypatch):
    """A chain goes on from the network's proposal as it came, towards the same target, whatever became of the samples;
    one that has arrived begins again at a free configuration elsewhere."""
    sampler = started(network, seed=4, upper=(1.5, 1.5, 0.9), points=3, spread=0.1, arrive=1.0, from_start=0.3)
    asked, space = answers(network, sampler, monkeypatch), sampler.adherence
    for _ in range(30):
        assert 0 < len(sampler.cover(100)) <= 60
    kept = blocked = arrived = 0
    for (_, target, proposals), (after, aim, _) in pairwise(asked):
        np.testing.assert_array_equal(aim, target)
        for row in range(20):
            if np.linalg.norm(proposals[row] - target[row]) > 1.0:
                np.testing.assert_array_equal(after[row], proposals[row])
                kept, blocked = kept + 1, blocked + (proposals[row, 2] > 0.9)
            else:
                assert space.validity.free(after[row]) and abs(np.linalg.norm(after[row]) - 1) < 1e-3
                arrived += 1
    assert kept > 40 and blocked > 3 and arrived > 5


def test_chains_begin_at_both_ends_and_anywhere(network, monkeypatch):
    """Of 20 chains a third goes from the start, a fifth from the goal; the others begin at free configurations."""
    sampler = started(network, from_start=0.35, from_goal=0.2)
    asked = answers(network, sampler, monkeypatch)
    sampler.cover(100)
    (current, target, _), start, goal = asked[0], np.eye(3)[0], np.eye(3)[2]
    np.testing.assert_array_equal(current[:7], [start] * 7)
    np.testing.assert_array_equal(current[16:], [goal] * 4)
    np.testing.assert_array_equal(target, [goal] * 16 + [start] * 4)
    between = current[7:16]
    assert np.abs(np.linalg.norm(between, axis=1) - 1).max() < 1e-3 and len(np.unique(between, axis=0)) == 9


def test_points_lie_on_the_way_to_the_proposals(network, monkeypatch):
    """Of five points per proposal, without spread, one is the proposal and four lie on the straight line to it from the
    current configuration, anywhere between; all are projected."""
    sampler, rng = started(network, seed=4, points=5), np.random.default_rng(1)
    current, target = on_sphere(rng, 20), on_sphere(rng, 20)
    asked = answers(network, sampler, monkeypatch)
    found = sampler.sample(current, target)
    onward = asked[0][2]
    assert found.shape == (100, 3) and sampler.counters.network_calls == 1 and sampler.counters.samples == 100
    ends = onward / np.linalg.norm(onward, axis=1)[:, None]
    np.testing.assert_allclose(found[:20], ends, atol=1e-3)
    full = np.arccos(np.clip((current * ends).sum(axis=1), -1, 1))
    for between in found[20:].reshape(4, 20, 3):
        there, back = (np.arccos(np.clip((between * other).sum(axis=1), -1, 1)) for other in (current, ends))
        np.testing.assert_allclose(there + back, full, atol=5e-3)  # on the great circle of both, between them
        assert np.ptp(there / full) > 0.5


def test_spread_is_what_is_added(network, monkeypatch):
    """What is added to the proposals has the asked standard deviation in each coordinate, and no direction."""
    sampler = started(network, points=1, spread=0.05)
    added, asked = [], answers(network, sampler, monkeypatch)
    sampler.adherence.project = lambda Q: added.append(Q - asked[-1][2]) or Q
    for seed in range(100):
        ask(sampler, 20, seed)
    together = np.concatenate(added)  # (2000, 3): five standard errors
    np.testing.assert_allclose(together.std(axis=0), 0.05, atol=5 * 0.05 / 4000**0.5)
    np.testing.assert_allclose(together.mean(axis=0), 0, atol=5 * 0.05 / 2000**0.5)


def test_equal_seeds_give_equal_samples(network):
    """The same seed gives the same samples, also through the change to the classical sampler; another seed others."""
    runs = [
        np.concatenate([ask(sampler, 5) for _ in range(4)])
        for sampler in (started(network, seed=seed, n_ismp=2) for seed in (7, 7, 8))
    ]
    np.testing.assert_array_equal(runs[0], runs[1])
    assert not np.isin(runs[2], runs[0]).any()


def test_samples_depend_on_the_scene_and_the_ends(network):
    """In another scene, or between other configurations, the network answers otherwise under the same chance."""
    samples = [ask(started(network), 20), ask(started(network, scene="bar"), 20), ask(started(network), 20, seed=2)]
    assert not np.isin(samples[1], samples[0]).any() and not np.isin(samples[2], samples[0]).any()


@pytest.mark.parametrize("n_ismp", [0, 3])
def test_after_n_ismp_calls_only_fallback_samples(network, n_ismp):
    """The network answers the first N_ismp calls and no more; what the classical sampler gives then is counted."""
    sampler = started(network, n_ismp=n_ismp)
    from_network = sum(len(ask(sampler, 20)) for _ in range(n_ismp))
    assert sampler.counters.network_calls == n_ismp and sampler.counters.fallback_samples == 0
    classical = np.concatenate([ask(sampler, 20) for _ in range(4)])
    assert sampler.counters.network_calls == n_ismp
    assert sampler.counters.fallback_samples == len(classical) == 80
    assert sampler.counters.samples == from_network + 80
    assert np.abs(np.linalg.norm(classical, axis=1) - 1).max() < 1e-3


@pytest.mark.parametrize("method", METHODS)
def test_without_calls_of_the_network_it_is_the_uniform_sampler(network, method):
    """With N_ismp = 0 the samples are those of the uniform sampler from the same stream, one for one."""
    sampler = started(network, method, seed=5, n_ismp=0)
    uniform = bound(UniformSampler(), begun(method), 5)
    for count in (1, 20, 7, 40):
        np.testing.assert_array_equal(ask(sampler, count), ask(uniform, count))


@pytest.mark.parametrize("method", METHODS)
def test_first_batch_is_the_networks_then_classical(network, method):
    """Of a first batch the network answers its calls; the rest is the uniform sampler's first batch, and counted."""
    sampler = started(network, method, seed=5, n_ismp=1)
    learned = sampler.cover(30)
    assert sampler.counters.network_calls == 1 and sampler.counters.fallback_samples == 0
    assert 0 < len(learned) <= 20 and not sampler.informed
    fallback, classical = bound(UniformSampler(20), begun(method), 5), started(network, method, seed=5, n_ismp=0)
    found = classical.cover(30)
    np.testing.assert_array_equal(found, fallback.cover(30))
    assert classical.counters.fallback_samples == len(found) > 0


def test_start_begins_anew(network):
    """Bound to a problem again, the network answers again, and the samples repeat from the first."""
    sampler = started(network, seed=6, n_ismp=1)
    first = [ask(sampler, 4) for _ in range(2)]
    space = begun("projection")
    bound(sampler, space, 6)
    np.testing.assert_array_equal([ask(sampler, 4) for _ in range(2)], first)
    assert (space.counters.network_calls, space.counters.fallback_samples) == (1, 4)


def test_time_in_the_network_is_counted(network):
    """The time inside the network grows with its calls and not with those of the classical sampler."""
    sampler = started(network, n_ismp=2)
    times = [sampler.network_time]
    for _ in range(4):
        ask(sampler, 20)
        times.append(sampler.network_time)
    assert 0 < times[0] < times[1] < times[2] == times[3] == times[4]


@pytest.mark.parametrize("scene", ["garden", None])
def test_unknown_scene_is_refused(network, scene):
    """A scene without voxels is refused with its name and some that there are."""
    with pytest.raises(ProblemError, match=rf"no voxels of scene {scene!r}; it has \['bar', 'kitchen'\]"):
        started(network, scene=scene)


def test_voxels_of_another_size_are_refused(network):
    """A grid that does not fit the network is refused with both sizes."""
    sampler = CompnetxSampler(network, {"large": np.zeros((40, 40, 40), bool)}, CompnetxParameters())
    with pytest.raises(ArtifactError, match=r"are \(40, 40, 40\); the network expects \(11, 11, 11\)"):
        bound(sampler, begun("projection"), 0, "large")


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("batch", 0, "0; it must be at least 1"),
        ("n_ismp", -1, "-1"),
        ("points", 0, "0; it must be at least 1"),
        ("spread", -0.1, "-0.1"),
        ("spread", np.nan, "nan"),
        ("from_start", 1.1, "1.1"),
        ("from_goal", -0.1, "-0.1"),
        ("arrive", -1.0, "-1.0"),
    ],
)
def test_wrong_parameters_are_refused(name, value, said):
    """A batch of none, a negative number of calls, no points or a negative spread is refused with name and value."""
    with pytest.raises(ConfigError, match=rf"sampler\.{name} is {said}"):
        CompnetxParameters(**{name: value})


def test_shares_of_chains():
    """Shares of chains from start and goal that add up to more than all are refused with both."""
    with pytest.raises(ConfigError, match=r"sampler\.from_start is 0\.6 and sampler\.from_goal 0\.5; together at most"):
        CompnetxParameters(from_start=0.6, from_goal=0.5)
    CompnetxParameters(from_start=0.5, from_goal=0.5)


def test_samplers_by_name(network):
    """A choice becomes its sampler with its parameters; a learned one needs a network, an unknown one is refused."""
    learned = Learned(network, VOXELS)
    uniform = make_sampler(Choice("uniform", {"batch": 5, "block": 6}))
    assert isinstance(uniform, UniformSampler) and (uniform.batch, uniform.block) == (5, 6) and not uniform.informed
    made = make_sampler(Choice("compnetx", {"batch": 7, "n_ismp": 8, "points": 2, "spread": 0.3}), learned)
    assert isinstance(made, CompnetxSampler) and made.informed
    asked = made.first.parameters
    assert (made.batch, made.calls, asked.points, asked.spread) == (7, 8, 2, 0.3)
    assert made.first.network is network and made.first.voxels is VOXELS
    with pytest.raises(ConfigError, match="sampler 'compnetx' needs a trained network: run the train stage"):
        make_sampler(Choice("compnetx"))
    with pytest.raises(ConfigError, match="sampler is 'sobol'; choices: compnetx, uniform"):
        make_sampler(Choice("sobol"), learned)
