"""The page of an environment: every sentence with a number in it is made from the trials."""

from collections.abc import Mapping

import pandas as pd

from pipeline.evaluation import Comparison, paired_interval
from pipeline.evaluation.choices import choices_table, equal_sizes_table
from pipeline.evaluation.tuning import RULE, Settings, tuned
from pipeline.reporting import sphere_pictures as pictures
from pipeline.reporting import tables, text, verdict
from pipeline.reporting.frames import both_solved, check_trials, method_pairs, ordered, pair
from pipeline.reporting.markdown import Illustration, Provenance, Section, escape, page
from pipeline.reporting.paper import Paper

_CHOICES_NOTE = (
    "Each row changes the parameters named in brackets; everything else is as in the results above. No test scene was "
    "used."
)
_GROUP_NOTE = (
    "Rows with group = 0.0 expand one sample after the other by code made for groups, which a "
    "queue would do in less time: they compare paths and checks, not speed."
)
_GROUPLESS = "group = 0.0"
_ENCODING_NOTE = (
    "A scene is encoded once, by the first plan in it, which is a warm-up here: no time on this page holds that "
    "encoding (its cost stands in the performance page's table of parts)."
)
_SIZES_NOTE = (
    "At equal N_init: what the network is worth apart from the smaller first batch that it allows. The results above "
    "compare each method at its own N_init (see 'What was run'); the paper does not give the learned one's. Of the "
    "learned method's samples the network draws as many as its calls allow; the table above has each row's share."
)
_PEERS = (
    "The paper's numbers are those it prints, by its own code at that time, which was not run here; later versions of "
    "it are not considered. Planners of OMPL, with the version that was measured, stand on the performance page."
)


def environment_page(
    trials: pd.DataFrame,
    illustrations: Mapping[str, Illustration],
    provenance: Provenance,
    choices: pd.DataFrame,
    settings: Settings,
    tried: Settings,
    paper: Paper,
) -> str:
    """Return the page in Markdown.

    Args:
        trials: of the benchmark.
        illustrations: of `environment_figures` and `sphere_stills`, by name; those that are missing are left out.
        provenance: commit, profile, machine, and the commands of 'benchmark', 'train' and 'report'.
        choices: trials of the variants on validation scenes.
        settings: of the methods, by `pipeline.evaluation.trials.method_settings`.
        tried: those of each variant of `choices`, with its 'base'.
        paper: the title, and what to compare with.

    Raises:
        ArtifactError: columns are missing or unknown.
    """
    check_trials(trials)
    check_trials(choices)
    benchmark, train = (provenance.commands.get(stage, "") for stage in ("benchmark", "train"))
    scenarios = ordered(trials["scenario"], "scenario")
    verdicts = verdict.verdict_table(trials, paper)
    results = tables.results_table(trials, paper)
    machine = (
        f"Times were measured on {escape(provenance.machine)}{'; the paper names no machine' * bool(paper.results)}."
    )

    def shown(*names: str) -> list[Illustration]:
        return [illustrations[name] for name in names if name in illustrations]

    sections = [
        Section("Summary", [*shown(*scenarios[:1]), *_summary(trials, verdicts, settings), machine], benchmark),
        Section("What was run", [_runs(trials, paper), _settings(trials, settings)], benchmark),
    ]
    for scenario, result in results.items():
        of = f" ({paper.scenarios[scenario]})" if scenario in paper.scenarios else ""
        parts: list[str | pd.DataFrame | Illustration] = []
        for name, columns in (
            ("Success", tables.OUTCOME),
            ("Planning time", tables.TIME),
            ("Path length", tables.length_columns(paper.unit)),
            ("Work", tables.EFFORT),
        ):
            parts += [f"### {name}, {scenario}", _known(result[list(columns)], paper)]
        parts += [escape(tables.RESULTS_NOTE), machine, *(shown(scenario) if scenario != scenarios[0] else [])]
        sections.append(Section(f"Results: {scenario}{of}", parts, benchmark))
    paired = _known(tables.paired_table(trials, paper, settings), paper)
    sections += [
        Section(
            "Learned against classical, problem by problem", [paired, escape(tables.PAIRED_NOTE), machine], benchmark
        ),
        Section(
            "Where the time of the learned methods goes",
            [*_shares(trials, settings, paper.unit), *_tails(trials, settings), _ENCODING_NOTE, machine],
            benchmark,
        ),
        Section(
            "What was tried, on validation scenes",
            [
                _tried_with(choices),
                f"{_CHOICES_NOTE} {_GROUP_NOTE}"
                if any(_GROUPLESS in name for name in choices["method"])
                else _CHOICES_NOTE,
                choices_table(choices, paper.unit),
                *_equal_sizes(choices, tried, settings, paper.unit),
                "### Which settings are measured, and by which rule",
                *_chosen(choices, tried, settings),
                machine,
            ],
            provenance.commands.get("choices", ""),
        ),
        Section(
            "Figures",
            [*shown(pictures.SUCCESS, pictures.TIME, pictures.LENGTH, pictures.PROGRESS), machine],
            provenance.commands["report"],
        ),
    ]
    samples = shown(*(pictures.SAMPLES + scenario for scenario in scenarios))
    if samples:
        sections.append(Section("Samples", samples, benchmark))
    if pictures.TRAINING in illustrations:
        sections.append(Section("Training", shown(pictures.TRAINING), train))
    sections += [
        Section("What was not solved, and why", [_rejected(trials), tables.rejection_table(trials)], benchmark),
    ]
    if len(verdicts):
        sections.append(Section("Every comparison", [verdicts, escape(verdict.VERDICT_NOTE), machine], benchmark))
    if paper.results:
        sections.append(Section("Where the paper's numbers stand", [_PEERS, _sources(paper)]))
    return page(paper.title, sections, provenance)


def environment_summary(
    trials: pd.DataFrame,
    illustrations: Mapping[str, Illustration],
    provenance: Provenance,
    settings: Settings,
    paper: Paper,
) -> Section:
    """Return the section of the index: the first picture and the expectations; see `environment_page`.

    Raises:
        ArtifactError: columns are missing or unknown.
    """
    first = [illustrations[s] for s in ordered(trials["scenario"], "scenario") if s in illustrations][:1]
    parts = [*first, *_summary(trials, verdict.verdict_table(trials, paper), settings)]
    return Section(paper.title, parts, provenance.commands.get("benchmark", ""))


def _summary(trials: pd.DataFrame, verdicts: pd.DataFrame, settings: Settings) -> list[str | pd.DataFrame]:
    if trials.empty:
        return ["There are no trials."]
    if verdicts.empty:
        return [*_headline(trials, settings)]
    summary = verdict.verdict_summary(verdicts)
    met, missed = (int((summary["met"] == answer).sum()) for answer in (verdict.YES, verdict.NO))
    open_ones = len(summary) - met - missed
    each = len(summary) // summary["scenario"].nunique()
    sentence = f"Of {len(summary)} expectations ({each} per scenario), met: {met}; not met: {missed}"
    sentence += f"; not to be compared: {open_ones}." if open_ones else "."
    return [*_headline(trials, settings), sentence, summary, escape(verdict.SUMMARY_NOTE)]


def _runs(trials: pd.DataFrame, paper: Paper) -> pd.DataFrame:
    rows = []
    for scenario in ordered(trials["scenario"], "scenario"):
        part = trials[trials["scenario"] == scenario]
        said = {"in the paper": paper.scenarios.get(scenario, text.NONE)} if paper.scenarios else {}
        rows.append({
            "scenario": scenario, **said,
            "scenes": part["scene"].nunique(), "problems": len(part[["scene", "problem"]].drop_duplicates()),
            "methods": part["method"].nunique(), "adherence methods": part["adherence"].nunique(),
            "n trials": len(part), "solved": int(part["solved"].astype(bool).sum()),
        })  # fmt: skip
    return pd.DataFrame(rows)


def _settings(trials: pd.DataFrame, settings: Settings) -> pd.DataFrame:
    return pd.DataFrame(
        [
            {
                "method": method,
                **{
                    f"its {part}": ", ".join(f"{k} = {v}" for k, v in parts[part].items())
                    for part in ("planner", "sampler")
                },
            }
            for method, parts in settings.items()
            if trials.empty or method in set(trials["method"])
        ]
    )


def _known(table: pd.DataFrame, paper: Paper) -> pd.DataFrame:
    """Return a table without the columns of the paper where there is none."""
    return table if paper.results else table[[name for name in table if not str(name).startswith("paper: ")]]


def _tuned_alike(settings: Settings) -> tuple[str, list[str]]:
    """Return the first method with a baseline that was tuned as it was, and all its baselines; else nothing."""
    found = (
        (method, parts["compared_with"])
        for method, parts in settings.items()
        if any(settings[baseline]["tuned_from"] for baseline in parts["compared_with"])
    )
    return next(found, ("", []))


def _equal_sizes(choices: pd.DataFrame, tried: Settings, settings: Settings, unit: str) -> list[str | pd.DataFrame]:
    learned, baselines = _tuned_alike(settings)
    bases = [settings[baseline]["tuned_from"] or baseline for baseline in baselines][:1]
    if choices.empty or not bases or not {parts["base"] for parts in tried.values()}.issuperset((*bases, learned)):
        return []
    return [escape(_SIZES_NOTE), equal_sizes_table(choices, tried, bases[0], learned, unit)]


def _chosen(choices: pd.DataFrame, tried: Settings, settings: Settings) -> list[str]:
    """Say what the rule chooses among the variants of each base, and whether that is what was measured."""
    if choices.empty:
        return ["Nothing was tried."]
    # The base itself is measured as the paper has it.
    measured = {parts["tuned_from"]: method for method, parts in settings.items() if parts["tuned_from"]}
    bases = list(dict.fromkeys(str(parts["base"]) for parts in tried.values()))
    found = [tuned(choices, tried, base, settings, measured.get(base, base)) for base in bases]
    lines = [f"- {escape(choice.sentence)}" for choice in found if choice is not None]
    return [f"One rule for all, on the same problems: {RULE}", *(["\n".join(lines)] if lines else [])]


def _headline(trials: pd.DataFrame, settings: Settings) -> list[str]:
    """Say how much faster ours is than the baseline tuned alike, and, beside it, than in the paper's setting."""
    lines, (ours, baselines) = [], _tuned_alike(settings)
    for scenario in ordered(trials["scenario"], "scenario"):
        for adherence in ordered(trials.loc[trials["scenario"] == scenario, "adherence"], "adherence"):
            said = []
            for baseline in baselines:
                fast, slow, scenes = both_solved(pair(trials, scenario, adherence, ours, baseline), "planning_time")
                if len(fast):
                    ratio, base = (
                        paired_interval(slow, fast, scenes, Comparison.RATIO),
                        settings[baseline]["tuned_from"],
                    )
                    name = (
                        f"{escape(base)} tuned by the same rule"
                        if base
                        else f"{escape(baseline)} in the paper's setting"
                    )
                    said.append(f"{text.interval(ratio, '×')} as fast as {name} (n = {len(fast)})")
            if said:
                lines.append(f"- {scenario}, {adherence.replace('_', ' ')}: {'; '.join(said)}")
    return [f"Ratios of median times of {escape(ours)}, 95 % intervals over scenes:", "\n".join(lines)] if lines else []


def _shares(trials: pd.DataFrame, settings: Settings, unit: str) -> list[str]:
    """Say in sentences what the network costs beside the whole classical plan, and what it saves in checks."""
    # The first plan in a scene encodes it; that one is the warm-up, which is not measured.
    said = []
    for scenario in ordered(trials["scenario"], "scenario"):
        for learned, classical in method_pairs(trials["method"], settings):
            part = trials[trials["scenario"] == scenario]
            ours, theirs = part[part["method"] == learned], part[part["method"] == classical]
            if ours.empty or theirs.empty:
                continue
            own, other = (f"{side['path_length'].median():.3f} {unit}" for side in (ours, theirs))
            network, whole = 1e3 * ours["network_time"].median(), 1e3 * theirs["planning_time"].median()
            together = 1e3 * ours["planning_time"].median()
            said.append(
                f"- {scenario}: {escape(classical)} plans in {whole:.1f} ms; the network alone takes {network:.1f} ms "
                f"of {escape(learned)}'s {together:.1f} ms, which is {network / whole:.0%} of "
                f"the whole classical plan: with a network that costs nothing the ratio of these medians would be "
                f"{whole / (1e3 * (ours['planning_time'] - ours['network_time']).median()):.2f}, with this one it is "
                f"{whole / together:.2f}. Collision checks: {ours['collision_checks'].median():.0f} against "
                f"{theirs['collision_checks'].median():.0f}; path length {own} against "
                f"{other} (medians over all adherence methods). Of {escape(learned)}'s "
                f"samples {ours['fallback_samples'].sum() / max(ours['samples'].sum(), 1):.0%} came from the classical "
                f"sampler, in all trials together."
            )
    return ["\n".join(said)] if said else []


def _tails(trials: pd.DataFrame, settings: Settings) -> list[str]:
    """Say in sentences how often batch planners need more than their first batch, and what the slowest plans weigh."""
    sizes, said, told = _first_batches(settings), [], set[tuple[str, str]]()
    for scenario in ordered(trials["scenario"], "scenario"):
        for learned, classical in method_pairs(trials["method"], settings):
            if learned not in sizes or classical not in sizes:
                continue
            for method in (name for name in (classical, learned) if (scenario, name) not in told):
                told.add((scenario, method))
                part = trials[(trials["scenario"] == scenario) & (trials["method"] == method)]
                if part.empty:
                    continue
                times, once = 1e3 * part["planning_time"], part["nearest_queries"] <= sizes[method]
                slow = times[times >= times.quantile(0.95)]
                later = f"the others in {times[~once].median():.1f} ms" if not once.all() else "there are no others"
                said.append(
                    f"- {scenario}: {once.mean():.0%} of {escape(method)}'s plans end with the first batch of "
                    f"{sizes[method]} samples, in {times[once].median():.1f} ms, {later} (medians over all adherence "
                    f"methods). The slowest twentieth of its plans takes {slow.sum() / times.sum():.0%} of its time."
                )
    if not said:
        return []
    reason = (
        "Why the ratio of the means is not that of the medians: a smaller first batch is planned in less time and more "
        "often does not reach the goal; what follows then is classical sampling for both. Whether the network is worth "
        "more than a smaller batch of classical samples is asked below, at equal N_init."
    )
    return [reason, "\n".join(said)]


def _first_batches(settings: Settings) -> dict[str, int]:
    """Return N_init of the methods that have one."""
    return {
        method: int(str(parts["planner"]["samples"]))
        for method, parts in settings.items()
        if "samples" in parts["planner"]
    }


def _tried_with(choices: pd.DataFrame) -> str:
    """Say which adherence methods the variants were tried with."""
    if choices.empty:
        return "Nothing was tried."
    names = sorted({str(name).replace("_", " ") for name in choices["adherence"]})
    return f"All with {' and '.join(names)}, in scenes of {' and '.join(sorted(set(choices['scenario'])))}."


def _rejected(trials: pd.DataFrame) -> str:
    solved, claimed = trials["solved"].astype(bool), trials["claimed"].astype(bool)
    return (
        f"{int((~solved).sum())} of {len(trials)} trials are not solved; in {int((claimed & ~solved).sum())} of them "
        "the planner claimed a path that the independent verifier rejected."
    )


def _sources(paper: Paper) -> pd.DataFrame:
    rows = [
        (r.scenario, r.method, adherence, r.time_text, r.success_text, r.length_text, r.said)
        for r in paper.results
        for adherence in r.adherences
    ]
    names = ["scenario", "method", "adherence", "time [s]", "success", "length", f"{paper.source}, section: sentence"]
    return pd.DataFrame(rows, columns=names)
