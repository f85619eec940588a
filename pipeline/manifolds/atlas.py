"""An atlas: charts that together parameterise a manifold (compnetx.txt, section II-C; Jaillet and Porta)."""

from dataclasses import dataclass

import numpy as np

from pipeline.constraints import Constraint
from pipeline.errors import ConfigError, ConstraintError, require
from pipeline.manifolds.base import AdherenceParameters, length
from pipeline.robots.turning import Turning

_NEAREST = 4  # charts that are asked whether they hold a configuration


@dataclass(frozen=True)
class AtlasParameters(AdherenceParameters):
    """Parameters of charts (compnetx.txt, appendix D, where no other source is given).

    Attributes:
        epsilon: largest distance between chart and manifold, below `step` [rad or m]: a shorter step counts as stalled.
        alpha: largest angle between a chart and a chord to the manifold [rad] (pi/6; the authors' code: pi/16).
        rho: radius of a chart's validity region [rad or m].
        exploration: probability of sampling outside the chart; samples reach rho / (1 - exploration)^(1/d).
        max_charts: the atlas takes no more than these.
        separate: whether half-spaces keep charts apart (atlas) or not (tangent bundle).
    """

    epsilon: float = 0.01
    alpha: float = np.pi / 6
    rho: float = 1.5
    exploration: float = 0.9
    max_charts: int = 5000
    separate: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        require("adherence.epsilon", self.epsilon, above=0)
        if not self.epsilon < self.step:
            raise ConfigError(
                f"adherence.epsilon is {self.epsilon} and step {self.step}; epsilon must be below the step, or every "
                "walk in a chart stalls at its first one"
            )
        require("adherence.alpha", self.alpha, above=0, below=np.pi / 2)
        require("adherence.rho", self.rho, above=0)
        require("adherence.exploration", self.exploration, at_least=0, below=1)
        require("adherence.max_charts", self.max_charts, above=1)


class Chart:
    """A tangent space at a configuration of the manifold, with an orthonormal basis.

    Attributes:
        origin: configuration on the manifold (n,).
        tangent: Phi, basis of the tangent space (n, d).
        normal: basis of its complement (n, k): the exponential map only moves along it (eq. 3).
    """

    def __init__(self, index: int, origin: np.ndarray, tangent: np.ndarray, normal: np.ndarray) -> None:
        self.index, self.origin, self.tangent, self.normal = index, origin, tangent, normal
        self.walls = np.empty((0, tangent.shape[1]))  # rows w: u is inside where u . w <= |w|^2 / 2
        self.limits = np.empty(0)
        self.known = 0  # charts of the atlas that the walls take into account

    def phi(self, u: np.ndarray) -> np.ndarray:
        """Return the point of the tangent space at u (d,) in the ambient space (n,) (eq. 2)."""
        return self.origin + self.tangent @ u

    def log(self, q: np.ndarray) -> np.ndarray:
        """Return psi^-1: the coordinates (d,) of a configuration q (n,) (eq. 4)."""
        return (q - self.origin) @ self.tangent


class Atlas:
    """Charts of one manifold, grown where they are needed.

    The validity region of eq. (5) is: distance to the chart at most epsilon, angle to it at most alpha, distance from
    its origin at most rho. The paper prints the angle's condition as |u| / |q_i - q_j| < cos(alpha), which holds for
    the invalid side: |u| / |q_i - q_j| is the cosine of the angle, large where the chart is good.

    Args:
        constraint: of the manifold.
        parameters: of charts.
        turns: of joints that turn, whose charts hold what is whole turns away; `seen` puts it into their coordinates.
    """

    def __init__(self, constraint: Constraint, parameters: AtlasParameters, turns: Turning | None = None) -> None:
        self.constraint, self.parameters, self.turns = constraint, parameters, turns
        self.charts: list[Chart] = []
        self._origins = np.empty((64, constraint.n))
        self._tangents = np.empty((64, constraint.manifold_dimension, constraint.n))
        self._normals = np.empty((64, constraint.k, constraint.n))
        self._cosine = float(np.cos(parameters.alpha))

    def __len__(self) -> int:
        return len(self.charts)

    @property
    def origins(self) -> np.ndarray:
        """Origins of all charts (m, n)."""
        return self._origins[: len(self.charts)]

    @property
    def tangents(self) -> np.ndarray:
        """Tangent bases of all charts, as rows (m, d, n)."""
        return self._tangents[: len(self.charts)]

    @property
    def normals(self) -> np.ndarray:
        """Normal bases of all charts, as rows (m, k, n)."""
        return self._normals[: len(self.charts)]

    def add(self, q: np.ndarray) -> Chart | None:
        """Add a chart at q (n,) on the manifold; None when the atlas is full or the Jacobian has lost rank there."""
        if len(self.charts) >= self.parameters.max_charts:
            return None
        try:
            tangent, normal = self.constraint.frame(q)
        except ConstraintError:
            return None
        if len(self.charts) == len(self._origins):
            for name in ("_origins", "_tangents", "_normals"):
                stacked = getattr(self, name)
                setattr(self, name, np.concatenate([stacked, np.empty_like(stacked)]))
        chart = Chart(len(self.charts), np.array(q, float), tangent, normal)
        i = chart.index
        self._origins[i], self._tangents[i], self._normals[i] = chart.origin, tangent.T, normal.T
        self.charts.append(chart)
        return chart

    def find(self, q: np.ndarray) -> Chart | None:
        """Return the chart whose validity region and polytope hold q (n,); None without one."""
        if not self.charts:
            return None
        offsets = self._apart(q - self.origins)
        squared = np.einsum("ij,ij->i", offsets, offsets)
        # The owner is among the nearest origins; a few bound the search where chords and tangents differ.
        for i in np.argsort(squared, kind="stable")[:_NEAREST].tolist():
            chart, offset = self.charts[i], offsets[i]
            if self._near(chart, offset):
                u = offset @ chart.tangent
                if self._in_region(u, offset) and self.in_polytope(chart, u):
                    return chart
        return None

    def at(self, q: np.ndarray) -> Chart | None:
        """Return the chart that holds q, or a new one there (GetChart of Algorithms 3 and 4)."""
        return self.find(q) or self.add(q)

    def seen(self, chart: Chart, q: np.ndarray, q_to: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return q and q_to (n,), both moved by the turns that bring q nearest to the chart's origin."""
        if self.turns is None:
            return q, q_to
        there = self.turns.nearest(q, chart.origin)
        return there, q_to + (there - q)

    def _apart(self, offsets: np.ndarray) -> np.ndarray:
        return offsets if self.turns is None else self.turns.wrapped(offsets)

    def in_region(self, chart: Chart, u: np.ndarray, q: np.ndarray) -> bool:
        """True when u (d,) and q = psi(u) (n,) satisfy eq. (5)."""
        offset = self._apart(q - chart.origin)
        return self._near(chart, offset) and self._in_region(u, offset)

    def _near(self, chart: Chart, offset: np.ndarray) -> bool:
        """The first condition of eq. (5), which most charts fail: to stand at most epsilon above the tangent space."""
        return length(offset @ chart.normal) <= self.parameters.epsilon

    def _in_region(self, u: np.ndarray, offset: np.ndarray) -> bool:
        """The others: coordinates u (d,) of an offset (n,) from the chart's origin, and the angle between the two."""
        reach = length(u)
        return reach <= self.parameters.rho and reach >= self._cosine * length(offset)

    def in_polytope(self, chart: Chart, u: np.ndarray) -> bool:
        """True when u (d,) is on the chart's side of all half-spaces; always, where charts are not kept apart."""
        if not self.parameters.separate:
            return True
        self._update_walls(chart)
        return not (chart.walls @ u > chart.limits).any()

    def outside(self, chart: Chart, U: np.ndarray) -> np.ndarray:
        """Tell for rows of U (m, d) whether they are outside the chart's polytope (m,)."""
        if not self.parameters.separate:
            return np.zeros(len(U), bool)
        self._update_walls(chart)
        return np.asarray((U @ chart.walls.T > chart.limits).any(axis=1))

    def _update_walls(self, chart: Chart) -> None:
        """Add the half-spaces of charts made since the last look: halfway to each neighbour within 2 rho and alpha.

        A chart farther than alpha from the tangent space lies around the bend: seen from here it would cut the region
        where none of the other takes over (with rho = 1.5 on a unit sphere, half of the sphere).
        """
        if chart.known == len(self.charts):
            return
        offsets = self._apart(self._origins[chart.known : len(self.charts)] - chart.origin)
        walls = offsets @ chart.tangent  # (m, d): the neighbours' origins as this chart sees them
        squared, seen = np.einsum("ij,ij->i", offsets, offsets), np.einsum("ij,ij->i", walls, walls)
        near = (squared < (2 * self.parameters.rho) ** 2) & (seen >= self._cosine**2 * squared)
        if chart.known <= chart.index:
            near[chart.index - chart.known] = False
        if near.any():
            chart.walls = np.concatenate([chart.walls, walls[near]])
            chart.limits = np.concatenate([chart.limits, 0.5 * seen[near]])
        chart.known = len(self.charts)
