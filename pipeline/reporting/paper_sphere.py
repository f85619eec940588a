"""What compnetx.txt reports about the sphere, as data: no number of the paper is written anywhere else in this room.

The paper gives its sphere results in prose only (section VII-A), without the number of trials and without saying what
follows its plus-minus sign; it is read here as mean and standard deviation over solved problems.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class PaperResult:
    """One method with one adherence in one scenario, as printed. None where the paper gives no number.

    Attributes:
        scenario, method, adherence: as in the trials.
        time: planning time, mean and deviation [s].
        time_range: planning time where the paper gives a range only [s].
        success: fraction solved.
        success_exceeds: the paper says 'over', not 'around'.
        length: path length on the unit sphere, mean and deviation.
        remark: what the paper says about the path length in words where it gives no number.
        source: section and sentence.
    """

    scenario: str
    method: str
    adherence: str
    time: tuple[float, float] | None = None
    time_range: tuple[float, float] | None = None
    success: float | None = None
    success_exceeds: bool = False
    length: tuple[float, float] | None = None
    remark: str = ""
    source: str = ""

    @property
    def time_text(self) -> str:
        """The time as the paper prints it [s]; empty when it gives none."""
        if self.time is not None:
            return f"{self.time[0]:g} ± {self.time[1]:g}"
        return "" if self.time_range is None else f"{self.time_range[0]:g} to {self.time_range[1]:g}"

    @property
    def success_text(self) -> str:
        """The success rate as the paper prints it; empty when it gives none."""
        if self.success is None:
            return ""
        return f"{'over' if self.success_exceeds else 'around'} {100 * self.success:g} %"

    @property
    def length_text(self) -> str:
        """The path length as the paper prints it, or its words; empty when it gives neither."""
        return self.remark if self.length is None else f"{self.length[0]:g} ± {self.length[1]:g}"


_BLOCKS_X = "VII-A: 'In the first scenario (Fig. 7), CoMPNetX-FMT* with atlas, tangent-bundle, and projection ...'"
_BLOCKS_FMT = "VII-A: 'In contrast, FMT* with atlas, tangent-bundle, and projection appeared to have ...'"
_BLOCKS_RRT = "VII-A: 'On the other hand, CoMPNetX-RRTConnect and RRTConnect exhibits similar computation times ...'"
_BANDS_X = "VII-A: 'In this case, CoMPNetX-FMT* with all types of constraint-adherence operators ...'"
_BANDS_FMT = "VII-A: 'The classical FMT* with atlas, tangent-bundle, and projection takes ...'"
_BANDS_RRT = "VII-A: 'CoMPNetX-RRTConnect and RRTConnect performed similarly in terms of computation times ...'"

_ADHERENCES = ("projection", "atlas", "tangent_bundle")
_LIKE_X = "somewhat similar to CoMPNetX-FMT*"
_SHORTER = "significantly better than RRTConnect"
_POORER = "poorer than CoMPNetX-RRTConnect"


def _fmt(scenario: str, times: Sequence[tuple[float, float]], rates: Sequence[float]) -> Iterable[PaperResult]:
    """FMT*'s results in the order of `_ADHERENCES`."""
    source, remark = (_BLOCKS_FMT, _LIKE_X) if scenario == "blocks" else (_BANDS_FMT, "")
    for adherence, time, rate in zip(_ADHERENCES, times, rates, strict=True):
        yield PaperResult(scenario, "FMT*", adherence, time=time, success=rate, remark=remark, source=source)


def _every_adherence(scenario: str, method: str, **values: object) -> Iterable[PaperResult]:
    """One result for all adherence methods, where the paper gives one number for the three."""
    for adherence in _ADHERENCES:
        yield PaperResult(scenario, method, adherence, **values)  # type: ignore[arg-type]  # fields pass through


SPHERE: tuple[PaperResult, ...] = (
    *_every_adherence(
        "blocks", "CoMPNetX-FMT*", time=(0.89, 0.13), success=0.99, success_exceeds=True, length=(2.18, 0.014),
        source=_BLOCKS_X,
    ),
    *_fmt("blocks", [(1.14, 0.027), (1.22, 0.034), (1.34, 0.061)], [0.98, 0.95, 0.89]),
    *_every_adherence("blocks", "CoMPNetX-RRTConnect", time_range=(0.01, 0.02), remark=_SHORTER, source=_BLOCKS_RRT),
    *_every_adherence("blocks", "RRTConnect", time_range=(0.01, 0.02), remark=_POORER, source=_BLOCKS_RRT),
    *_every_adherence(
        "bands", "CoMPNetX-FMT*", time=(0.55, 0.11), success=0.96, length=(3.13, 1.8), source=_BANDS_X
    ),
    *_fmt("bands", [(0.95, 0.34), (1.93, 1.34), (2.05, 1.44)], [1.00, 0.89, 0.87]),
    # The sentence on RRTConnect in scenario 2 compares the two methods with each other and gives no time.
    *_every_adherence("bands", "CoMPNetX-RRTConnect", source=_BANDS_RRT),
    *_every_adherence("bands", "RRTConnect", remark=_POORER, source=_BANDS_RRT),
)  # fmt: skip


_SAME = {"CoMPNetX-FMT*, Algorithm 6": "CoMPNetX-FMT*"}  # our name: the paper's, for what the paper describes


def find(paper: Iterable[PaperResult], scenario: str, method: str, adherence: str) -> PaperResult | None:
    """Return the paper's result of a method, or None where the paper says nothing about it."""
    wanted = (scenario, _SAME.get(method, method), adherence)
    return next((r for r in paper if (r.scenario, r.method, r.adherence) == wanted), None)


def speed_up(paper: Sequence[PaperResult], scenario: str, adherence: str, learned: str, classical: str) -> float | None:
    """Return the paper's ratio of mean times, classical over learned, or None where it gives no two means."""
    fast, slow = find(paper, scenario, learned, adherence), find(paper, scenario, classical, adherence)
    if fast is None or slow is None or fast.time is None or slow.time is None:
        return None
    return slow.time[0] / fast.time[0]
