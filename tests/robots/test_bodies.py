"""Pieces of meshes enclose them and are close to them; verdicts and messages are those of the bodies they are of."""

import logging
from dataclasses import replace
from functools import cache

import coal
import numpy as np
import pytest
import yaml
from scipy.spatial import ConvexHull, cKDTree

from pipeline.errors import ProblemError, RobotError
from pipeline.robots import ROBOTS, Geometry, Obstacle, Robot, Shape, UrdfRobot, Validity, attach
from pipeline.robots.bodies import body_of, hull
from pipeline.robots.kept import kept_pieces
from pipeline.robots.pieces import convex_pieces
from pipeline.robots.surfaces import triangles
from pipeline.schema import Choice
from tests.robots.named import FOLDER, configurations
from tests.robots.worlds import rotation

FAR = 0.05  # no piece of Baxter's torso and pedestal stands out farther [m]; their hulls do by 0.17 and 0.27


def boxes(*sides: tuple[tuple[float, ...], tuple[float, ...]]) -> np.ndarray:
    """Triangles (M, 3, 3) of boxes that may overlap, each from its lower to its upper corner."""
    found = []
    for low, high in sides:
        vertices, faces = triangles(coal.Box(*np.subtract(high, low)))
        found.append((vertices + np.add(high, low) / 2)[faces])
    return np.concatenate(found)


def beyond_boxes(*sides):
    """The distance of points (N, 3) from the nearest of boxes; 0 inside."""

    def distance(points: np.ndarray) -> np.ndarray:
        off = [np.maximum(np.subtract(low, points), np.subtract(points, high)) for low, high in sides]
        return np.min([np.linalg.norm(np.maximum(o, 0), axis=1) for o in off], axis=0)

    return distance


def torus(major: float, minor: float) -> np.ndarray:
    """Triangles (M, 3, 3) of a torus about z, 24 by 10."""
    u, v = (np.linspace(0, 2 * np.pi, count, endpoint=False) for count in (24, 10))
    u, v = np.meshgrid(u, v, indexing="ij")
    ring = major + minor * np.cos(v)
    points = np.stack([ring * np.cos(u), ring * np.sin(u), minor * np.sin(v)], axis=-1)
    corners = [np.roll(points, (-i, -j), axis=(0, 1)).reshape(-1, 3) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
    return np.concatenate([np.stack([corners[0], corners[i], corners[i + 1]], axis=1) for i in (1, 2)])


def beyond_torus(points: np.ndarray) -> np.ndarray:
    """The distance of points (N, 3) from the solid torus of 0.3 and 0.06."""
    ring = np.hypot(points[:, 0], points[:, 1]) - 0.3
    return np.maximum(np.hypot(ring, points[:, 2]) - 0.06, 0)


def ball() -> np.ndarray:
    """Triangles (M, 3, 3) of a ball of radius 0.2."""
    vertices, faces = triangles(coal.Sphere(0.2))
    return vertices[faces]


def winding(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """How often triangles (M, 3, 3) go around each of points (N, 3), by their solid angles."""
    found = []
    for point in points:
        a, b, c = (corners - point).swapaxes(0, 1)
        na, nb, nc = (np.sqrt((side * side).sum(axis=1)) for side in (a, b, c))
        dots = [(x * y).sum(axis=1) for x, y in ((a, b), (b, c), (c, a))]
        angle = np.arctan2((a * np.cross(b, c)).sum(axis=1), na * nb * nc + dots[0] * nc + dots[1] * na + dots[2] * nb)
        found.append(angle.sum() / (2 * np.pi))
    return np.array(found)


CROSS = (
    ((-0.5, -0.1, -0.1), (0.5, 0.1, 0.1)),
    ((-0.1, -0.4, -0.1), (0.1, 0.4, 0.1)),
    ((0, 0, -0.3), (0.05, 0.05, 0.3)),
)
ARCH = (((0, 0, 0), (0.1, 0.2, 0.5)), ((0.4, 0, 0), (0.5, 0.2, 0.5)), ((0, 0, 0.5), (0.5, 0.2, 0.6)))  # parts touch
# Triangles, distance from the solid, share of the hull's volume that is left and how far pieces stand out at most [m].
SOLIDS = {
    "cross": (boxes(*CROSS), beyond_boxes(*CROSS), 0.4, 1e-9),
    "arch": (boxes(*ARCH), beyond_boxes(*ARCH), 0.54, 1e-9),
    "torus": (torus(0.3, 0.06), beyond_torus, 0.5, 0.02),
    "ball": (ball(), lambda points: np.maximum(np.linalg.norm(points, axis=1) - 0.2, 0), 1.0, 1e-9),
}


def on_triangles(rng: np.random.Generator, corners: np.ndarray, count: int) -> np.ndarray:
    """Random points of triangles (count, 3), as many of each as its share of the area."""
    a, b, c = corners.swapaxes(0, 1)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = rng.choice(len(corners), count, p=area / area.sum())
    weights = rng.dirichlet(np.ones(3), count)  # (count, 3)
    return np.einsum("ni,nid->nd", weights, corners[chosen])


def depths(pieces: list[np.ndarray], points: np.ndarray) -> np.ndarray:
    """How far points (N, 3) are beyond the planes of each piece (P, N); below 0 inside."""
    planes = [ConvexHull(piece).equations for piece in pieces]
    return np.array([(points @ p[:, :3].T + p[:, 3]).max(axis=1) for p in planes])


def outside(pieces: list[np.ndarray], points: np.ndarray) -> float:
    """How far the farthest of points (N, 3) is from being in a piece."""
    return float(depths(pieces, points).min(axis=0).max())


@pytest.mark.parametrize("name", SOLIDS)
def test_pieces_enclose_solids_and_are_close(name):
    """Every point of a solid and of its surface is in a piece, no point of a piece is far from it, turned or not."""
    corners, beyond, share, far = SOLIDS[name]
    rng = np.random.default_rng(0)
    inside = rng.uniform(corners.min(axis=(0, 1)), corners.max(axis=(0, 1)), (1000, 3))
    inside = inside[winding(inside, corners) > 0.5]
    points = np.concatenate([inside, on_triangles(rng, corners, 5000)])
    pieces = convex_pieces(corners)
    assert outside(pieces, points) < 1e-9
    whole = ConvexHull(corners.reshape(-1, 3)).volume
    assert sum(ConvexHull(piece).volume for piece in pieces) < (share + 1e-9) * whole
    for piece in pieces:
        assert beyond(rng.dirichlet(np.full(len(piece), 0.3), 500) @ piece).max() < far
    R = rotation(rng.normal(size=4))
    turned = convex_pieces(corners @ R.T)
    assert outside(turned, points @ R.T) < 1e-9
    assert sum(ConvexHull(piece).volume for piece in turned) < ((share + 1) / 2 + 1e-9) * whole


def test_surfaces_are_enclosed():
    """Of a bowl, a plate and triangles without order, wound at random, every point is in a piece."""
    rng = np.random.default_rng(1)
    bowl = ball()[(ball()[:, :, 2] < 0.05).all(axis=1)]
    plate = boxes(((0, 0, 0), (0.3, 0.2, 0.001)))
    plate = plate[(plate[:, :, 2] == 0).all(axis=1)]  # one side of it: flat
    soup = rng.normal(size=(60, 1, 3)) * 0.3 + rng.normal(size=(60, 3, 3)) * 0.05
    for corners in (bowl, plate, soup):
        wound = np.where(rng.random((len(corners), 1, 1)) < 0.5, corners, corners[:, ::-1])
        pieces = convex_pieces(rng.permutation(wound))
        assert outside(pieces, on_triangles(rng, corners, 3000)) < 1e-9


def test_convex_meshes_stay_whole():
    """A box and a ball are one piece with the corners of their hulls; what is small is not cut either."""
    for corners in (boxes(((0, 0, 0), (1, 2, 0.5))), ball(), boxes(*CROSS) * 0.04):
        (piece,) = convex_pieces(corners)
        assert ConvexHull(piece).volume == pytest.approx(ConvexHull(corners.reshape(-1, 3)).volume)


def settings(name: str) -> UrdfRobot:
    """The settings of a robot of conf/robot or, for the UR5, of its example without the SRDF."""
    if name == "ur5":
        file = yaml.safe_load((FOLDER.parents[1] / "examples/own_robot_ur5.yaml").read_text())["robot"]
        return replace(Choice(**file).make(ROBOTS, "robot"), srdf="")
    return Choice(**yaml.safe_load((FOLDER / f"{name}.yaml").read_text())).make(ROBOTS, "robot")


@cache
def robot(name: str, kind: Geometry) -> Robot:
    return replace(settings(name), geometry=kind).robot()


@pytest.mark.parametrize("body", ["torso_0", "pedestal_0"])
def test_baxters_pieces(body):
    """Baxter's torso and pedestal are in their pieces, and these stand out from them by less than 5 cm."""
    rng = np.random.default_rng(2)
    meshes, cut = robot("baxter_right", Geometry.MESHES), robot("baxter_right", Geometry.PIECES)
    vertices, faces = triangles(meshes.geometry.geometryObjects[meshes.geometry.getGeometryId(body)].geometry)
    corners = vertices[faces]
    shapes = [triangles(piece.geometry) for piece in cut.geometry.geometryObjects if body_of(piece.name) == body]
    assert 8 < len(shapes) < 24
    pieces = [points for points, _ in shapes]
    assert outside(pieces, on_triangles(rng, corners, 10_000)) < 1e-9
    near = cKDTree(on_triangles(rng, corners, 100_000))
    points = np.concatenate([on_triangles(rng, points[sides], 400) for points, sides in shapes])
    own = np.repeat(np.arange(len(pieces)), 400)
    into = depths(pieces, points)
    into[own, np.arange(len(own))] = np.inf
    seen = points[(into.min(axis=0) > 1e-6) & (near.query(points)[0] > FAR)]  # not covered by other pieces
    assert (np.abs(winding(seen, corners)) > 0.5).all()


def test_verdicts_lie_between_those_of_meshes_and_hulls():
    """What meets as a mesh meets as pieces, what does so meets as hulls, and pieces are hardly ever wrong."""
    rng = np.random.default_rng(3)
    for name, wrong in (("baxter_both", 0.01), ("ur5", 0.03)):
        kinds = [Validity(robot(name, kind), []) for kind in (Geometry.MESHES, Geometry.PIECES, Geometry.HULLS)]
        Q = configurations(kinds[0].robot, rng, 300)
        mesh, pieces, hulls = (np.array([validity.free(q) for q in Q]) for validity in kinds)
        assert not (pieces & ~mesh).any() and not (hulls & ~pieces).any()
        assert (mesh & ~pieces).mean() <= wrong and (mesh & ~hulls).mean() > (mesh & ~pieces).mean()


def test_messages_and_exceptions_name_the_body():
    """Pieces have names of their own, contacts name the body they are of, once, and `touching` takes that name.

    What may touch a body is in contact with it no more than before, and with all others as before.
    """
    cut, rng = robot("baxter_right", Geometry.PIECES), np.random.default_rng(4)
    names = cut.pieces_of("pedestal_0")
    assert len(set(cut.body_names)) == len(cut.body_names) and len(names) > 8
    assert names[0] == f"pedestal_0 (1 of {len(names)})" and cut.pieces_of(names[0]) == (names[0],)
    assert cut.pieces_of("head_0") == ("head_0",) and cut.pieces_of("hat") == ()
    crate = Obstacle(Shape.BOX, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.8, 0.8, 0.8), "crate")
    Q = configurations(cut, rng, 20)
    holds, beside = (Validity(attach(cut, crate, "right_gripper", others), []) for others in ((), ["pedestal_0"]))
    met = [holds.contacts(q) for q in Q]
    assert any(("pedestal_0", "crate") in pairs for pairs in met) and all(len(set(p)) == len(p) for p in met)
    assert sum(len(beside.contacts(q)) for q in Q) <= sum(map(len, met))
    for q, pairs in zip(Q, met, strict=True):
        others = [pair for pair in pairs if pair != ("pedestal_0", "crate")]
        assert [pair for pair in beside.contacts(q) if pair != ("pedestal_0", "crate")] == others
    with pytest.raises(RobotError, match=r"did you mean 'pedestal_0'.*there are: "):
        attach(cut, crate, "right_gripper", ["pedestal"])
    with pytest.raises(ProblemError, match=r"'pedestal' \(did you mean 'pedestal_0'\?\)"):
        Validity(cut, [crate], touching=[("pedestal", "crate")])


def test_kept_pieces_are_those_made_anew(tmp_path, monkeypatch, caplog):
    """What comes out of the cache is the same to the bit; a broken file, or no place to write, costs time only."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    corners = boxes(*CROSS[:2])

    def same() -> bool:
        found, made = kept_pieces(corners), convex_pieces(corners)
        return len(found) == len(made) and all(a.tobytes() == b.tobytes() for a, b in zip(found, made, strict=True))

    assert same()
    (file,) = tmp_path.rglob("*.npz")
    assert same() and [file] == list(tmp_path.rglob("*.*"))
    with caplog.at_level(logging.WARNING):
        for spoilt in (b"", file.read_bytes()[:-200]):
            file.write_bytes(spoilt)
            assert same() and "cannot be read" in caplog.text
            caplog.clear()
        (tmp_path / "file").write_text("")
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
        assert same() and "cannot be written" in caplog.text


def test_hulls_enclose_where_coal_needs_fewer_corners():
    """A hull with too many neighbours for coal is a little larger than its vertices, never smaller."""
    angle = np.linspace(0, 2 * np.pi, 1500, endpoint=False)
    rim = np.stack([0.2 * np.cos(angle), 0.2 * np.sin(angle), np.zeros(1500)], axis=1)
    cone = np.concatenate([rim, [[0.0003, 0.0004, 0.30051]]])
    made = np.array(hull(cone, "cone").points())
    assert len(made) < 1000
    planes = ConvexHull(made).equations
    assert (cone @ planes[:, :3].T + planes[:, 3]).max() < 1e-9
    planes = ConvexHull(cone).equations
    assert (made @ planes[:, :3].T + planes[:, 3]).max() < 0.002 * np.sqrt(3) + 1e-9
