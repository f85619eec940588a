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
        allowed: how deep they may be in each other [m], of which a margin keeps some; 0 where they may not touch.
    """

    first: str
    second: str
    distance: float
    least: float
    allowed: float = 0.0

    def __str__(self) -> str:
        how = f"{-self.distance:.3g} m deep" if self.distance < 0 else f"{self.distance:.3g} m apart"
        bound = f", with a margin of {self.least:.3g} m"
        if self.allowed > 0:
            kept_back = self.allowed + self.least
            bound = f", of at most {self.allowed:.3g} m"
            bound += f", of which the margin keeps {kept_back:.3g} m" if kept_back > 0 else ""
        return f"{self.first} with {self.second} ({how}{bound if self.least or self.allowed else ''})"


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
    for pair, least, depth in zip(scene.robot.geometry.collisionPairs, own, scene.pair_depths.tolist(), strict=True):
        names = scene.body_names[pair.first], scene.body_names[pair.second]
        found.append((names, bodies[pair.first], bodies[pair.second], least, depth))
    near = sorted(distances.near(scene.moving, R, p, margin + reserve), key=lambda pair: pair[::-1])
    depths = [scene.depth(*pair) for pair in near]
    others = kept(margin, np.array(depths, float), reserve).tolist()
    for (body, number), least, depth in zip(near, others, depths, strict=True):
        names = scene.body_names[body], scene.names[number]
        found.append((names, bodies[body], distances.obstacle(number), least, depth))
    near_ones: dict[tuple[str, ...], TooNear] = {}
    for names, here, there, least, depth in found:
        if here.nearer(there, least):
            one = TooNear(body_of(names[0]), body_of(names[1]), here.distance(there), least, depth)
            known = near_ones.get((one.first, one.second))
            if known is None or one.distance < known.distance:  # of the pieces of a body the nearest is named
                near_ones[one.first, one.second] = one
    return list(near_ones.values())
