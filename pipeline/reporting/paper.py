"""What a paper reports about an environment, as data: its numbers stand in conf/paper and nowhere else."""

from dataclasses import dataclass, field, replace

from pipeline.errors import require


@dataclass(frozen=True)
class PaperResult:
    """One method in one scenario, as printed. None where the paper gives no number.

    Attributes:
        scenario, method: as in the trials.
        adherences: adherence methods that the paper gives this one number for.
        said: section and sentence.
        time: planning time, mean and deviation [s].
        time_range: planning time where the paper gives a range only [s].
        success: fraction solved.
        success_exceeds: the paper says 'over', not 'around'.
        length: path length, mean and deviation.
        remark: what the paper says about the path length in words where it gives no number.
    """

    scenario: str
    method: str
    adherences: tuple[str, ...]
    said: str = ""
    time: tuple[float, float] | None = None
    time_range: tuple[float, float] | None = None
    success: float | None = None
    success_exceeds: bool = False
    length: tuple[float, float] | None = None
    remark: str = ""

    def __post_init__(self) -> None:
        for name in ("time", "time_range", "length"):
            for value in getattr(self, name) or ():
                require(f"results: {name} in {self.said!r}", value, at_least=0)
        if self.success is not None:
            require(f"results: success in {self.said!r}", self.success, at_least=0, at_most=1)

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


@dataclass(frozen=True)
class Paper:
    """What a page compares with; see conf/paper. Without a paper there are no results.

    Attributes:
        title: of the page; the name of its environment where it is empty.
        source: name of the paper's text.
        unit: of path lengths.
        scenarios: what each scenario is in the paper.
        same: our names of methods that the paper has under another name: its name.
        faster, shorter: pairs of methods of which the first is expected to plan faster, and to find shorter paths.
        by_ratio: pairs of which the first is expected to plan faster by at least the ratio of the paper's mean times.
        drawn: methods whose paths its picture draws.
        results: what it says.
    """

    title: str = ""
    source: str = ""
    unit: str = "m"
    scenarios: dict[str, str] = field(default_factory=dict)
    same: dict[str, str] = field(default_factory=dict)
    faster: tuple[tuple[str, str], ...] = ()
    shorter: tuple[tuple[str, str], ...] = ()
    by_ratio: tuple[tuple[str, str], ...] = ()
    drawn: tuple[str, ...] = ()
    results: tuple[PaperResult, ...] = ()

    def titled(self, environment: str) -> "Paper":
        """Return the same with a title: made of the environment's name where there is none."""
        return self if self.title else replace(self, title=environment.replace("_", " ").capitalize())

    def find(self, scenario: str, method: str, adherence: str) -> PaperResult | None:
        """Return the paper's result of a method, or None where the paper says nothing about it."""
        theirs = self.same.get(method, method)
        for result in self.results:
            if (result.scenario, result.method) == (scenario, theirs) and adherence in result.adherences:
                return result
        return None

    def speed_up(self, scenario: str, adherence: str, learned: str, classical: str) -> float | None:
        """Return the paper's ratio of mean times, classical over learned, or None where it gives no two means."""
        fast, slow = self.find(scenario, learned, adherence), self.find(scenario, classical, adherence)
        if fast is None or slow is None or fast.time is None or slow.time is None:
            return None
        return slow.time[0] / fast.time[0]
