"""IPOPT for programs whose objective and rows are a structure: made once, called with numbers and bounds."""

import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from pipeline.constraints.structure import Structure

_ITERATIONS = 200  # nine solves in ten that arrive take fewer than 100
_OPTIONS: dict[str, Any] = {
    "ipopt.max_iter": _ITERATIONS,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",  # no banner
    "ipopt.bound_relax_factor": 0.0,  # a bound is one: by default it may be passed by 1e-8 of it
    "print_time": 0,
    "show_eval_warnings": False,  # what is not finite is a failure, which is returned
    "calc_lam_p": False,  # nobody asks for sensitivities
}


class Found(NamedTuple):
    """Where a solve ended.

    Attributes:
        q: configuration (n,), within the limits.
        rows: their values there (m,).
        optimal: whether it is a local minimum within the bounds, as far as IPOPT can tell.
    """

    q: np.ndarray
    rows: np.ndarray
    optimal: bool


class Ipopt:
    """Minimises the first row of a structure, with bounds on the others and on the variables.

    Rows may be given slack, each a variable whose square is added to the objective. So equations may say the same thing
    twice, disagree a little, and be more than the variables, all of which IPOPT alone does not take. Second derivatives
    are exact. IPOPT (Waechter and Biegler 2006) and its linear solver MUMPS are part of CasADi.
    """

    def __init__(self, structure: Structure) -> None:
        self._n, self._m = structure.n, structure.k - 1
        q, slack, e = (ca.SX.sym(*symbol) for symbol in (("q", self._n), ("slack", self._m), ("e", self._m)))
        rows = structure.rows(q)
        self._rows = ca.Function("rows", [q, structure.p], [ca.densify(rows[1:, 0])])
        program = {
            "x": ca.vertcat(q, e),
            "p": ca.vertcat(structure.p, slack),
            "f": rows[0] + ca.sumsqr(e),
            "g": rows[1:, 0] - slack * e,
        }
        self._clock = _Clock(self._n + self._m, self._m, structure.p.numel() + self._m)
        self._solver = ca.nlpsol("program", "ipopt", program, {**_OPTIONS, "iteration_callback": self._clock})

    def __call__(
        self,
        q: np.ndarray,
        numbers: np.ndarray,
        limits: tuple[np.ndarray, np.ndarray],
        bounds: tuple[np.ndarray, np.ndarray],
        slack: np.ndarray,
        until: float,
    ) -> Found:
        """Return where a solve ends that begins at q (n,).

        Args:
            q: see above.
            numbers: of the structure (p,).
            limits: lower and upper ones of the variables, (n,) each.
            bounds: lower and upper ones of the rows but the first, (m,) each.
            slack: how far rows may be out of bounds (m,). The squared share that is taken is added to the objective.
            until: time by time.perf_counter() at which it gives up [s].
        """
        self._clock.until = until
        most = (slack > 0).astype(float)
        end = self._solver(
            x0=np.concatenate([q, np.zeros(self._m)]),
            p=np.concatenate([numbers, slack]),
            lbx=np.concatenate([limits[0], -most]),
            ubx=np.concatenate([limits[1], most]),
            lbg=bounds[0],
            ubg=bounds[1],
        )
        q = np.clip(np.array(end["x"]).reshape(-1)[: self._n], *limits)
        rows = np.array(self._rows(q, numbers)).reshape(-1)
        return Found(q, rows, bool(self._solver.stats()["success"]) and bool(np.isfinite([*q, *rows]).all()))


class _Clock(ca.Callback):
    """Stops IPOPT between iterations once a time is over: a tenth of an arm's iteration."""

    def __init__(self, variables: int, rows: int, numbers: int) -> None:
        super().__init__()
        self.until = np.inf
        sizes = {"x": variables, "f": 1, "g": rows, "lam_x": variables, "lam_g": rows, "lam_p": numbers}
        self._shapes = [ca.Sparsity.dense(sizes[ca.nlpsol_out(i)], 1) for i in range(ca.nlpsol_n_out())]
        self.construct("clock", {})

    def get_n_in(self) -> int:
        return len(self._shapes)

    def get_n_out(self) -> int:
        return 1

    def get_name_in(self, i: int) -> str:
        return ca.nlpsol_out(i)

    def get_name_out(self, i: int) -> str:
        return "stop"

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return self._shapes[i]

    def eval(self, arguments: Sequence[ca.DM]) -> list[int]:
        return [int(time.perf_counter() >= self.until)]
