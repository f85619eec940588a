"""Which bodies are too near at a configuration, and how near: for messages, where a verdict alone does not help."""

from dataclasses import dataclass

import numpy as np

from pipeline.robots.bodies import body_of
from pipeline.robots.clearance import Distances
from pipeline.robots.contact import kept


@dataclass(frozen=True)
class TooNear:
    """Two bodies that are nearer than they may be.

    Attributes:
        first, second: their names.
        distance: of the two [m]; negative where they are in each other.
        least: that they must keep [m]; negative where they may touch.
    """

    first: str
    second: str
    distance: float
    least: float

    def __str__(self) -> str:
        how = f"{-self.distance:.3g} m deep" if self.distance < 0 else f"{self.distance:.3g} m apart"
        bound = f", of at most {-self.least:.3g} m" if self.least < 0 else f", with a margin of {self.least:.3g} m"
        return f"{self.first} with {self.second} ({how}{bound if self.least else ''})"


def too_near(distances: Distances, q: np.ndarray, margin: float, self_margin: float, reserve: float) -> list[TooNear]:
    """Return the pairs that are nearer than they may be at q (n,).

    Args:
        distances: of the scene.
        q: configuration.
        margin: to obstacles [m].
        self_margin: between bodies [m].
        reserve: that all keep besides [m].
    """
    scene, found = distances.scene, []
    R, p = distances.at(q)
    bodies = [distances.body(i, R, p) for i in range(len(scene.bodies))]
    own = kept(self_margin, scene.pair_depths, reserve).tolist()
    for pair, least in zip(scene.robot.geometry.collisionPairs, own, strict=True):
        names = scene.body_names[pair.first], scene.body_names[pair.second]
        found.append((names, bodies[pair.first], bodies[pair.second], least))
    near = sorted(distances.near(scene.moving, R, p, margin + reserve), key=lambda pair: pair[::-1])
    others = kept(margin, np.array([scene.depth(*pair) for pair in near], float), reserve).tolist()
    for (body, number), least in zip(near, others, strict=True):
        names = scene.body_names[body], scene.names[number]
        found.append((names, bodies[body], distances.obstacle(number), least))
    near_ones: dict[tuple[str, ...], TooNear] = {}
    for names, here, there, least in found:
        if here.nearer(there, least):
            one = TooNear(body_of(names[0]), body_of(names[1]), here.distance(there), least)
            known = near_ones.get((one.first, one.second))
            if known is None or one.distance < known.distance:  # of the pieces of a body the nearest is named
                near_ones[one.first, one.second] = one
    return list(near_ones.values())
