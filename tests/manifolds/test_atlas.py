"""Charts obey equations (1) to (5), divide the sphere among themselves and leave nothing out."""

import numpy as np
import pytest

from pipeline.manifolds import Atlas, AtlasParameters, ProjectionAdherence
from tests.manifolds.spaces import CHARTED, SHARP, arm_world, make, point_world, sphere_space, torus_points
from tests.robots.worlds import differences, fibonacci, on_sphere, sphere

EPSILON, ALPHA = 0.01, np.pi / 6
REACH = np.sqrt(1 - (1 - EPSILON) ** 2)  # |u| at which the unit sphere is epsilon below its tangent plane


def torus_space(method: str = "atlas", **settings):
    constraint, validity, world = point_world("torus", [])
    return make(method, constraint, validity, **settings), world, torus_points(np.random.default_rng(0), 8)


def arm_space(method: str = "atlas", **settings):
    constraint, validity, world, q0 = arm_world(6)
    rng = np.random.default_rng(0)
    points = [constraint.project(q0 + rng.normal(scale=0.1, size=13)).q for _ in range(4)]
    return make(method, constraint, validity, lookahead=1, **settings), world, np.array(points)


SPACES = {"torus": torus_space, "arm": arm_space}


@pytest.mark.parametrize("name", SPACES)
def test_basis_solves_equation_1(name):
    """At a chart's origin (J; Phi^T) Phi = (0; I), with the Jacobian from differences."""
    space, world, points = SPACES[name]()
    for q in points:
        chart = space.atlas.add(q)
        d = space.constraint.manifold_dimension
        left = np.vstack([differences(world.value, q), chart.tangent.T]) @ chart.tangent
        np.testing.assert_allclose(left, np.vstack([np.zeros((space.constraint.k, d)), np.eye(d)]), atol=1e-8)
        np.testing.assert_allclose(chart.tangent.T @ chart.normal, 0, atol=1e-12)


@pytest.mark.parametrize("name", SPACES)
def test_exponential_solves_equation_3(name):
    """psi(u) is on the manifold, and its offset from phi(u) is orthogonal to the chart."""
    space, world, points = SPACES[name]()
    rng = np.random.default_rng(1)
    for q in points:
        chart = space.atlas.add(q)
        for _ in range(5):
            u = 0.05 * rng.normal(size=chart.tangent.shape[1])
            found = space.exponential(chart, u)
            assert np.linalg.norm(world.value(found)) < SHARP
            np.testing.assert_allclose(chart.tangent.T @ (found - chart.origin - chart.tangent @ u), 0, atol=1e-12)


@pytest.mark.parametrize("count", [1, 5, 32])
@pytest.mark.parametrize("name", SPACES)
def test_many_are_lifted_as_one(name, count):
    """Coordinates lifted together end where each ends alone, and the same of them converge."""
    (space, _, points), rng = SPACES[name](), np.random.default_rng(4)
    for q in points:
        space.atlas.add(q)
    charts = rng.integers(len(points), size=count)
    U = rng.normal(scale=0.2, size=(count, space.constraint.manifold_dimension))
    Q, lifted = space._lift(charts, U)
    singles = [space.exponential(space.atlas.charts[i], u) for i, u in zip(charts, U, strict=True)]
    assert lifted.tolist() == [q is not None for q in singles]
    assert lifted.any()
    for q, single in zip(Q[lifted], [q for q in singles if q is not None], strict=True):
        np.testing.assert_allclose(q, single, atol=1e-9)


@pytest.mark.parametrize("name", SPACES)
def test_logarithm_inverts_the_exponential(name):
    """log(exp(u)) = u for coordinates around a chart's origin, and exp(log(q)) = q for configurations there."""
    space, world, points = SPACES[name]()
    rng = np.random.default_rng(2)
    for q in points:
        chart = space.atlas.add(q)
        np.testing.assert_array_equal(chart.log(q), 0)
        for _ in range(5):
            u = 0.05 * rng.normal(size=chart.tangent.shape[1])
            np.testing.assert_allclose(chart.log(space.exponential(chart, u)), u, atol=1e-12)
            np.testing.assert_allclose(chart.log(chart.phi(u)), u, atol=1e-12)
            near = world.project(q + 0.03 * rng.normal(size=len(q)), 20)
            np.testing.assert_allclose(space.exponential(chart, chart.log(near)), near, atol=1e-7)


def test_exponential_of_the_sphere():
    """On the unit sphere psi(u) is the point sqrt(1 - |u|^2) above the plane; beyond |u| = 1 there is none."""
    space = sphere_space("atlas")
    chart = space.atlas.add(np.array([0.0, 0.0, 1.0]))
    for u in np.array([[0.1, 0.2], [0.5, -0.3], [0.0, 0.8]]):
        expected = chart.tangent @ u + np.array([0.0, 0.0, np.sqrt(1 - u @ u)])
        np.testing.assert_allclose(space.exponential(chart, u), expected, atol=1e-3)
    assert space.exponential(chart, np.array([1.2, 0.3])) is None


@pytest.mark.parametrize(
    "settings, bound",
    [
        ({}, REACH),
        ({"rho": 0.08}, 0.08),
        # |u| = sin(angle), the chord is 2 sin(angle / 2), their ratio cos(angle / 2): alpha is half of the angle.
        ({"epsilon": 10.0, "alpha": 0.2, "step": 11.0, "resolution": 1.0}, np.sin(0.4)),
    ],
)
def test_region_of_equation_5(settings, bound):
    """On the unit sphere a chart is valid up to the angle at which epsilon, alpha or rho is first exceeded."""
    atlas = Atlas(sphere(), AtlasParameters(**settings))
    chart = atlas.add(np.array([0.0, 0.0, 1.0]))
    for q in on_sphere(np.random.default_rng(0), 300):
        u = np.hypot(q[0], q[1])
        holds = q[2] > 0 and u < bound
        if abs(u - bound) > 1e-9:
            assert atlas.in_region(chart, chart.log(q), q) == holds
            assert (atlas.find(q) is chart) == holds
    for u in (bound * 0.999, bound * 1.001):
        q = np.array([u, 0.0, np.sqrt(1 - u * u)])
        assert atlas.in_region(chart, chart.log(q), q) == (u < bound)


def test_half_spaces_are_halfway_to_each_neighbour():
    """A chart's polytope is what is nearer to its origin than to any neighbour's, all seen in its own plane."""
    atlas, rng = Atlas(sphere(), AtlasParameters(rho=0.5)), np.random.default_rng(0)
    for q in on_sphere(rng, 60):
        atlas.add(q)
    for chart in atlas.charts[:10]:
        offsets = atlas.origins - chart.origin
        chords = np.linalg.norm(offsets, axis=1)
        seen = offsets @ chart.tangent
        # Neighbours: within 2 rho, and seen from here at an angle below alpha (half of the arc between them).
        near = (chords > 0) & (chords < 1.0) & (2 * np.arcsin(chords / 2) / 2 <= ALPHA)
        assert near.sum() >= 3
        for u in rng.normal(scale=0.3, size=(50, 2)):
            nearest = all(np.linalg.norm(u) <= np.linalg.norm(u - w) for w in seen[near])
            assert atlas.in_polytope(chart, u) == nearest
            assert atlas.outside(chart, u[None]).tolist() == [not nearest]


def grown(parameters: AtlasParameters, points: np.ndarray) -> Atlas:
    atlas = Atlas(sphere(), parameters)
    for q in points:
        atlas.at(q)
    return atlas


def overlap(atlas: Atlas, q: np.ndarray) -> list[float]:
    """How deep q is inside the polytope of each chart whose region holds it: the least distance to a half-space."""
    depths = []
    for chart in atlas.charts:
        u = chart.log(q)
        if atlas.in_region(chart, u, q):
            atlas.in_polytope(chart, u)
            lengths = np.sqrt(2 * chart.limits)
            depths.append(float((lengths / 2 - chart.walls @ u / lengths).min()))
    return depths


@pytest.mark.parametrize("rho", [0.12, 1.5])
def test_charts_do_not_overlap(rho):
    """No point of a covered sphere is in two polytopes, but for slivers along their borders.

    For charts an angle t apart and a point r from both, the border is tan(t / 2) (cos^2(t / 2) - cos(r)) off the point:
    at most REACH^3 / 2 within the regions.
    """
    atlas, sliver = grown(AtlasParameters(rho=rho), fibonacci(1500)), REACH**3 / 2
    held = 0
    for q in fibonacci(700):
        inside = [depth for depth in overlap(atlas, q) if depth > sliver]
        assert len(inside) <= 1
        held += len(inside)
    assert held > 0.85 * 700


@pytest.mark.parametrize("settings", [{}, {"rho": 0.3}, {"epsilon": 0.04}])
def test_charts_cover_the_sphere(settings):
    """A grown atlas holds all points of the sphere but slivers along borders, and is not larger than it must be."""
    parameters, rng = AtlasParameters(**settings), np.random.default_rng(0)
    reach = np.sqrt(1 - (1 - parameters.epsilon) ** 2)
    points = on_sphere(rng, 2000)
    atlas = grown(parameters, np.concatenate([on_sphere(rng, 2000), points]))
    missed = [q for q in points if atlas.find(q) is None]
    assert len(missed) < 0.01 * len(points)
    for q in missed:
        assert max(overlap(atlas, q)) > -(reach**3) / 2
    assert len(atlas) < 5 * 4 / reach**2  # caps of radius `reach` have an area of pi reach^2, the sphere of 4 pi
    before = len(atlas)
    for q in fibonacci(500):
        atlas.at(q)
    assert len(atlas) - before < 0.05 * 500


def test_charts_around_the_bend_take_nothing_away():
    """A chart on the opposite side of the sphere, within 2 rho, leaves a chart's polytope as it is."""
    for opposite in ([0.0, 0.0, -1.0], [0.1, 0.0, -np.sqrt(0.99)]):
        atlas = Atlas(sphere(), AtlasParameters())
        first = atlas.add(np.array([0.0, 0.0, 1.0]))
        atlas.add(np.array(opposite))
        for q in fibonacci(400):
            if np.arccos(q[2]) < 0.13:
                assert atlas.find(q) is first


def test_found_chart_holds_the_configuration():
    """`find` gives a chart whose region and polytope hold the configuration; `at` makes one where there is none."""
    atlas = Atlas(sphere(), AtlasParameters())
    assert atlas.find(np.array([1.0, 0.0, 0.0])) is None
    for q in on_sphere(np.random.default_rng(1), 150):
        found, before = atlas.find(q), len(atlas)
        chart = atlas.at(q)
        if found is not None:
            assert chart is found and len(atlas) == before
            assert atlas.in_region(chart, chart.log(q), q) and atlas.in_polytope(chart, chart.log(q))
        else:
            assert len(atlas) == before + 1
            np.testing.assert_array_equal(chart.origin, q)
            np.testing.assert_array_equal(atlas.origins[-1], q)
    assert [chart.index for chart in atlas.charts] == list(range(len(atlas)))


def test_full_atlas_takes_no_more():
    """Beyond max_charts, and where there is no tangent space, no chart is made and the atlas stays as it is."""
    atlas = Atlas(sphere(), AtlasParameters(max_charts=3))
    assert atlas.add(np.zeros(3)) is None and len(atlas) == 0
    charts = [atlas.add(q) for q in fibonacci(5)]
    assert [chart is None for chart in charts] == [False] * 3 + [True] * 2
    assert len(atlas) == 3


def test_tangent_bundle_keeps_no_half_spaces():
    """The bundle's charts overlap: whatever others there are, a chart holds its whole region."""
    bundle, atlas = sphere_space("tangent bundle"), sphere_space("atlas")
    origins = [[0.0, 0.0, 1.0], [np.sin(0.1), 0.0, np.cos(0.1)]]
    q = np.array([np.sin(0.09), 0.0, np.cos(0.09)])
    for space, inside in ((bundle, True), (atlas, False)):
        charts = [space.atlas.add(np.array(origin)) for origin in origins]
        u = charts[0].log(q)
        assert space.atlas.in_region(charts[0], u, q)
        assert space.atlas.in_polytope(charts[0], u) == inside
        assert space.atlas.outside(charts[0], np.array([u, 2 * u])).tolist() == [not inside] * 2
        assert len(charts[0].walls) == (0 if inside else 1)
        assert space.parameters.separate != inside


@pytest.mark.parametrize("method", CHARTED)
def test_anchors_begin_the_atlas(method):
    """An anchored configuration is a chart's origin and counted; a reset forgets it."""
    space = sphere_space(method)
    space.anchor(np.array([0.0, 1.0, 0.0]))
    space.anchor(np.array([0.0, 1.0, 0.0]))
    np.testing.assert_array_equal(space.atlas.origins, [[0.0, 1.0, 0.0]])
    assert space.counted().charts == 1
    space.reset()
    assert len(space.atlas) == 0 and space.counted().charts == 0


def test_projection_has_no_charts():
    """The projection method takes an anchor and keeps nothing of it."""
    space = sphere_space("projection")
    assert isinstance(space, ProjectionAdherence)
    space.anchor(np.array([0.0, 1.0, 0.0]))
    assert space.counted().charts == 0
