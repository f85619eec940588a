"""Training pairs: even spacing, on the manifold, the right neighbours, the right split."""

from itertools import pairwise

import numpy as np
import pandas as pd
import pytest

from pipeline.errors import ArtifactError, ConfigError
from pipeline.learning.compnetx.pairs import demonstration_pairs, resample, split_by_scene


def row(scene: str, path: np.ndarray, problem: int = 0) -> dict:
    path = np.asarray(path, float)
    return {
        "scene": scene,
        "problem": problem,
        "path": path.ravel().tolist(),
        "waypoints": len(path),
        "dimension": path.shape[1],
    }


def arc(angle: float, count: int) -> np.ndarray:
    """A quarter of the way round the unit sphere, in unequal steps."""
    t = angle * np.linspace(0, 1, count) ** 1.7
    return np.stack([np.cos(t), np.sin(t), np.zeros(count)], axis=1)


def on_sphere(Q: np.ndarray) -> np.ndarray:
    return Q / np.linalg.norm(Q, axis=1, keepdims=True)


def test_resample_straight():
    """On a straight line the points are where arithmetic puts them, and the ends are exact."""
    path = np.array([[0.0, 0.0], [0.3, 0.0], [1.0, 0.0]])
    np.testing.assert_allclose(resample(path, 0.3)[:, 0], [0, 0.25, 0.5, 0.75, 1])
    np.testing.assert_allclose(resample(path, 0.25)[:, 0], [0, 0.25, 0.5, 0.75, 1])
    np.testing.assert_allclose(resample(path, 5.0), path[[0, 2]])
    assert resample(path[[0, 0]], 0.3).shape == (1, 2)


def test_resample_curved():
    """On a bent polyline every point lies on it, at equal arc length measured by brute force."""
    path = np.cumsum(np.random.default_rng(0).normal(size=(6, 3)), axis=0)
    points = resample(path, 0.2)
    dense = np.concatenate([a + np.linspace(0, 1, 20001)[:, None] * (b - a) for a, b in pairwise(path)])
    travelled = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(dense, axis=0), axis=1))])
    nearest = [np.linalg.norm(dense - p, axis=1).argmin() for p in points]
    assert max(np.linalg.norm(dense[i] - p) for i, p in zip(nearest, points, strict=True)) < 1e-3
    gaps = np.diff(travelled[nearest])
    np.testing.assert_allclose(gaps, travelled[-1] / (len(points) - 1), atol=1e-3)
    assert gaps.max() <= 0.2 + 1e-3
    assert np.array_equal(points[[0, -1]], path[[0, -1]])


def test_pairs_of_an_arc():
    """A path on the sphere becomes pairs on the sphere, evenly spaced, each towards the path's last state."""
    frame = pd.DataFrame([row("b", arc(1.2, 400))])
    pairs = demonstration_pairs(frame, ["a", "b"], spacing=0.2, project=on_sphere)
    assert len(pairs) == 6
    assert pairs.scene.tolist() == [1] * 6
    angles = np.arange(7) * 0.2
    expected = np.stack([np.cos(angles), np.sin(angles), np.zeros(7)], axis=1)
    np.testing.assert_allclose(pairs.current, expected[:-1], atol=1e-4)
    np.testing.assert_allclose(pairs.following, expected[1:], atol=1e-4)
    np.testing.assert_allclose(pairs.target, np.tile(expected[-1], (6, 1)), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(pairs.following, axis=1), 1, atol=1e-6)


def test_reverse():
    """Reversed paths ask from the goal towards the start, with the same states in the other order."""
    frame = pd.DataFrame([row("a", arc(1.0, 30)), row("b", arc(0.7, 30), 1)])
    forward = demonstration_pairs(frame, ["a", "b"], 0.1)
    both = demonstration_pairs(frame, ["a", "b"], 0.1, reverse=True)
    count = len(forward)
    assert len(both) == 2 * count
    assert np.array_equal(both[np.arange(count)].current, forward.current)
    back = both[np.arange(count, 2 * count)]
    assert sorted(map(tuple, back.current)) == sorted(map(tuple, forward.following))
    assert sorted(map(tuple, back.following)) == sorted(map(tuple, forward.current))
    assert np.array_equal(back.scene, forward.scene)
    np.testing.assert_allclose(back.target, np.tile([1.0, 0, 0], (count, 1)))


def test_projected_in_one_call():
    """All inner points are projected together, in order; ends are never touched."""
    seen = []

    def project(Q):
        seen.append(Q)
        return Q + np.array([0, 0, 1])

    frame = pd.DataFrame([row("a", arc(1.0, 30)), row("a", arc(0.15, 30), 1), row("a", arc(0.05, 3), 2)])
    pairs = demonstration_pairs(frame, ["a"], 0.1, project)
    assert len(seen) == 1
    assert len(seen[0]) == 9 + 1 + 0
    raised = pairs.following[:, 2] == 1
    assert raised.tolist() == [True] * 9 + [False] + [True, False] + [False]
    assert (pairs.target[:, 2] == 0).all()


def test_paths_without_pairs():
    """Unsolved problems (no waypoints) and paths without length give no pairs; nothing at all gives none."""
    empty = {"scene": "a", "problem": 1, "path": [], "waypoints": 0, "dimension": 3}
    still = row("a", np.ones((4, 3)), 2)
    frame = pd.DataFrame([empty, still, row("a", arc(1.0, 30))])
    assert len(demonstration_pairs(frame, ["a"], 0.1)) == 10
    none = demonstration_pairs(frame[:2], ["a"], 0.1)
    assert len(none) == 0
    assert none.current.shape == (0, 3)


def test_bad_demonstrations():
    """Foreign or damaged demonstrations are refused by what is wrong with them."""
    frame = pd.DataFrame([row("a", arc(1.0, 30))])
    with pytest.raises(ConfigError, match=r"spacing is 0\.0"):
        demonstration_pairs(frame, ["a"], 0.0)
    with pytest.raises(ArtifactError, match="waypoints"):
        demonstration_pairs(frame.drop(columns="waypoints"), ["a"], 0.1)
    with pytest.raises(ArtifactError, match="without voxels"):
        demonstration_pairs(frame, ["b"], 0.1)
    with pytest.raises(ArtifactError, match="31 waypoints x 3"):
        demonstration_pairs(frame.assign(waypoints=31), ["a"], 0.1)
    with pytest.raises(ArtifactError, match="89 of them finite"):
        demonstration_pairs(pd.DataFrame([row("a", np.where(arc(1.0, 30) == 1, np.nan, arc(1.0, 30)))]), ["a"], 0.1)
    with pytest.raises(ArtifactError, match="projection"):
        demonstration_pairs(frame, ["a"], 0.1, project=lambda Q: Q[1:])


def test_split():
    """Each scene is on one side only, and no pair is lost."""
    scenes = ["a", "b", "c"]
    frame = pd.DataFrame([row(s, arc(0.5 + 0.1 * i, 30), i) for i, s in enumerate("abcabc")])
    pairs = demonstration_pairs(frame, scenes, 0.1)
    train, validation = split_by_scene(pairs, scenes, ["b"])
    assert set(train.scene) == {0, 2}
    assert set(validation.scene) == {1}
    assert len(train) + len(validation) == len(pairs)
    assert np.array_equal(validation.current, pairs.current[pairs.scene == 1])
    with pytest.raises(ConfigError, match="'z'"):
        split_by_scene(pairs, scenes, ["z"])
    with pytest.raises(ConfigError, match="0 of"):
        split_by_scene(pairs, scenes, [])
    with pytest.raises(ConfigError, match="both need"):
        split_by_scene(pairs, scenes, scenes)
