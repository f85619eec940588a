"""Every configuration composes, converts and makes its parts; what makes no sense is refused by name."""

import copy
import importlib
import re
from collections.abc import Iterator
from dataclasses import asdict, fields, is_dataclass
from itertools import product
from pathlib import Path
from typing import Any

import pytest
import yaml
from hydra import initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.types import RunMode
from omegaconf import OmegaConf

from pipeline.config import compose, load
from pipeline.constraints import sphere_constraint
from pipeline.environments import ENVIRONMENTS
from pipeline.errors import ConfigError
from pipeline.evaluation.choices import variants
from pipeline.evaluation.trials import Experiment
from pipeline.learning.choices import Learned, make_sampler
from pipeline.learning.compnetx import Layers
from pipeline.learning.recipe import Recipe
from pipeline.manifolds import make_adherence
from pipeline.planners import PLANNERS
from pipeline.profile import BenchmarkScale, ChoicesScale, ScenesScale, TrainScale
from pipeline.robots import ROBOTS, Validity, point_robot
from pipeline.samplers.uniform import UniformParameters
from pipeline.schema import Choice, convert
from pipeline.spec.environment import EnvironmentChoice

CONF = Path(__file__).resolve().parent.parent / "conf"
STAGES = sorted(
    path.stem for path in CONF.glob("*.yaml") if path.stem not in ("bench", "bench_arms", "soak")
)  # whose opponents and families are fixed
GROUPS = sorted(path.name for path in CONF.iterdir() if path.is_dir() and path.name != "hydra")


def schema(stage: str) -> Any:
    """Return the dataclass that a stage converts its configuration into: the one its script names."""
    module = importlib.import_module(f"stages.{stage}")
    (name,) = re.findall(r"load\(cfg, (\w+)\)", Path(module.__file__).read_text())
    return getattr(module, name)


def files_of(group: str) -> list[str]:
    return sorted(path.stem for path in (CONF / group).glob("*.yaml"))


def choices_of(stage: str) -> dict[str, str]:
    """Return what the command line may choose: override key -> choice, as 'planner@method.planner' -> 'fmt'."""
    with initialize_config_dir(str(CONF), version_base="1.3"):
        found = GlobalHydra.instance().config_loader().compute_defaults_list(stage, [], RunMode.RUN)
    return {key: choice for key, choice in found.overrides.known_choices.items() if not key.startswith("hydra")}


def parts(value: Any, where: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Choice]]:
    """Return every choice inside a converted configuration, with its place."""
    if isinstance(value, Choice):
        yield where, value
    elif is_dataclass(value):
        for f in fields(value):
            yield from parts(getattr(value, f.name), (*where, f.name))
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from parts(item, (*where, key))


def make(where: tuple[str, ...], choice: Choice) -> Any:
    """Make the object a choice stands for as the stages do; its place tells the group."""
    group = next(name for name in reversed(where) if name.rstrip("s") in GROUPS).rstrip("s")
    if group == "environment":
        return choice.environment(ENVIRONMENTS)
    if group == "planner":
        return choice.make(PLANNERS, group)
    if group == "sampler":
        return make_sampler(choice, Learned(None, {}))  # samplers ask the network when they start, not before
    if group == "robot":
        return choice.make(ROBOTS, group)
    if group == "model":  # a recipe makes its own
        return convert(choice.parameters["layers"], Layers)
    assert group == "adherence"
    robot = point_robot(0.001, [-1.1] * 3, [1.1] * 3)
    return make_adherence(choice, sphere_constraint(robot, "point"), Validity(robot, ()))


def convert_all(stage: str, plain: Any, skip: tuple[str, ...] = ()) -> None:
    """Convert a configuration as the stage does and make all its parts; `skip` leaves out those of a group."""
    config = load(plain, schema(stage))
    found = list(parts(config))
    if isinstance(config, Recipe):
        config.parameters()
    if stage == "choices":  # whose methods are variants of those it names
        found += parts(variants(config.bases, config.variants))
    for where, choice in found:
        if not set(where) & set(skip):
            make(where, choice)


def leaves(value: Any, where: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], Any]]:
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from leaves(item, (*where, key))
    if not isinstance(value, dict | list):
        yield where, value


def holds(composed: Any, content: Any) -> bool:
    if isinstance(composed, dict) and isinstance(content, dict):
        said = {key: value for key, value in content.items() if key != "defaults"}
        return all(key in composed and holds(composed[key], value) for key, value in said.items())
    return composed == content


def changed(plain: Any, where: tuple[Any, ...], value: Any) -> Any:
    found = copy.deepcopy(plain)
    inner = found
    for key in where[:-1]:
        inner = inner[key]
    inner[where[-1]] = value
    return found


@pytest.mark.parametrize("stage", STAGES)
def test_every_choice_composes_and_converts(stage):
    """Every environment's configuration, and the first one's with every other choice, convert into the dataclass."""
    chosen_alike = re.findall(r"- (\w+): \$\{own_or", (CONF / f"{stage}.yaml").read_text())
    keys, plain = choices_of(stage), OmegaConf.to_container(compose(stage), resolve=True)
    for name in files_of("environment") if "environment" in keys else ():
        convert_all(stage, compose(stage, [f"environment={name}"]))
    convert_all(stage, plain)
    offered = {
        key: files_of(key.partition("@")[0])
        for key, choice in keys.items()
        # What a file changes of its choice need not fit another one.
        if key not in ("environment", *chosen_alike) and has(plain, key, choice)
    }
    for k in range(max(map(len, offered.values()), default=0)):  # all groups take their k-th choice at once
        chosen = {key: names[k % len(names)] for key, names in offered.items()}
        config = compose(stage, [f"{key}={name}" for key, name in chosen.items()])
        load(config, schema(stage))
        for key, name in chosen.items():
            assert has(OmegaConf.to_container(config), key, name)


def has(composed: Any, key: str, name: str) -> bool:
    """Tell whether a configuration has all that a chosen file says, its own list of defaults apart."""
    group, _, package = key.partition("@")
    text = (CONF / group / f"{name}.yaml").read_text()
    for part in () if "@package _global_" in text else (package or group).split("."):
        composed = composed[part]
    return holds(composed, yaml.safe_load(text))


def test_every_file_is_read_by_a_stage():
    """Every file of a group can be chosen in some stage and makes what it names; so does what the benchmarks read."""
    for name in ("bench", "bench_arms", "soak"):
        convert_all(name, compose(name))
    families = set(compose("soak").soak.families)
    assert set(compose("bench_arms").contest.families) <= families == set(files_of("family"))
    read = {key.partition("@")[0] for stage in STAGES for key in choices_of(stage)}
    assert read == set(GROUPS) - {"robot", "family"}  # tests/robots makes all robots, which problem files choose too
    for name in files_of("environment"):
        make(("environment",), load(compose("scenes", [f"environment={name}"]).environment, EnvironmentChoice))
    for group in ("adherence", "planner", "sampler"):
        for name in files_of(group):
            choice = load(yaml.safe_load((CONF / group / f"{name}.yaml").read_text()), Choice)
            make((group,), choice)


@pytest.mark.parametrize("path", sorted(CONF.rglob("*.yaml")), ids=lambda p: p.stem)
def test_files_say_what_they_are(path):
    """Every file begins with a comment, a stage's with the command that runs it; `name` is the name of the file."""
    comment = re.match("(# .*\n)+", path.read_text()).group()
    if path.parent == CONF:
        assert re.search(rf"python stages/{path.stem}\.py|make {path.stem}\b", comment)
    content = yaml.safe_load(path.read_text())
    assert content.get("name", path.stem) == path.stem
    if path.parent.name != "hydra":  # DVC's `exp run -S` dies of interpolations: numbers stand in files without
        text = path.read_text()
        followed = r": \$\{own_or:\w+,\$\{environment\},arm\}\n|environments: \$\{environments:\}"
        assert "${" not in (re.sub(followed, "", text) if path.parent == CONF else text)


def test_compose_is_the_command_line():
    """Overrides reach the value they name, and only that."""
    before, after = (OmegaConf.to_container(compose("scenes", o)) for o in ([], ["profile.scenes.pairs=7"]))
    assert [k for (k, a), (_, b) in zip(leaves(before), leaves(after), strict=True) if a != b] == [
        ("profile", "scenes", "pairs")
    ]
    assert after["profile"]["scenes"]["pairs"] == 7


@pytest.mark.parametrize(
    ("stage", "override", "said"),
    [
        (
            "scenes",
            "+worker=1",
            ["unknown key 'worker'", "did you mean 'workers'?", "Valid keys: profile, environment"],
        ),
        (
            "demonstrations",
            "+oracle.shortcut=1",
            ["unknown key 'shortcut' in oracle", "'shortcuts'?", "max_iterations"],
        ),
        ("voxels", "+perception.voxels.sice=1", ["unknown key 'sice' in perception.voxels", "'size'?", "density"]),
        (
            "train",
            "+model.parameters.layers.hiden=[1]",
            ["unknown key 'hiden' in model.layers", "'hidden'?", "dropout"],
        ),
        ("benchmark", "+experiment.methods.fmt.lable=a", ["'lable' in experiment.methods.fmt", "'label'?", "sampler"]),
        ("scenes", "+environment.parameters.block=1", ["unknown key 'block' in environment", "'blocks'?", "latitude"]),
        ("scenes", "environment.kind=sfere", ["environment is 'sfere'", "choices: family, folder, sphere"]),
        ("demonstrations", "oracle.planner.kind=prm", ["planner is 'prm'", "choices: fmt, rrt, rrtconnect"]),
        (
            "demonstrations",
            "oracle.adherence.kind=x",
            ["adherence is 'x'", "choices: atlas, projection, tangent_bundle"],
        ),
        ("tune", "method.sampler.kind=x", ["sampler is 'x'", "choices: compnetx, uniform"]),
        ("scenes", "~workers", ["lacks workers"]),
        ("scenes", "profile.scenes.pairs=many", ["profile.scenes.pairs is 'many' (str)", "type int"]),
        ("scenes", "profile.scenes.pairs=0", ["profile.scenes.pairs is 0", "above 0"]),
        ("train", "profile.train.epochs=0", ["profile.train.epochs is 0", "above 0"]),
        ("train", "model.parameters.reverse=1", ["reverse is 1 (int)", "type bool"]),
        ("train", "model.parameters.layers.dropout=1", ["network.dropout is 1.0", "below 1"]),
        ("benchmark", "experiment.time_limit=0", ["time_limit is 0.0 s", "above 0 s"]),
        ("benchmark", "+experiment.verifier.endpoint=nan", ["verifier.endpoint is nan", "finite and above 0"]),
        ("voxels", "perception.voxels.lower=[0,0]", ["perception.voxels.lower has 2 items", "expected 3"]),
        ("scenes", "environment.parameters.bands.0.side=2", ["band.side is 2", "choices: -1, 1"]),
        ("scenes", "workers=${nowhere}", ["cannot be resolved", "nowhere"]),
        *(
            (stage, f"{key}={name}", [f"{key} is {name!r}; files are named after it", "digits and '_', '-', '.'"])
            for stage in ("scenes", "demonstrations", "voxels", "train", "benchmark", "choices", "tune")
            for key, name in (("profile.name", "../../evil"), ("environment.name", "../../../precious"))
        ),
        ("scenes", "profile.name=", ["profile.name is ''"]),
        ("scenes", "environment.name=/tmp/x", ["environment.name is '/tmp/x'"]),
        ("report", "environments=[sphere,../../x]", ["a name in environments is '../../x'"]),
        ("benchmark", "experiment.methods.fmt.label=../x", ["experiment.methods.fmt.label is '../x'"]),
        (
            "benchmark",
            "+experiment.adherences={a/b:${experiment.adherences.atlas}}",
            ["experiment.adherences is 'a/b'"],
        ),
        ("soak", "+soak={families:{a/b:${soak.families.maze}},loads:{a/b:${soak.loads.maze}}}", ["families is 'a/b'"]),
    ],
)
def test_wrong_values_are_named(stage, override, said):
    """A wrong key or value is refused with its name, itself, and the bound or the alternatives."""
    with pytest.raises(ConfigError) as caught:
        convert_all(stage, compose(stage, [override]))
    assert [words for words in said if words not in str(caught.value)] == []


# Judged later by what uses them: how many processes and pieces (run_shards, shards), and the numbers of trials
# (Experiment, pick).
LATER = {
    "demonstrations": ("workers", "shard"),
    "scenes": ("workers",),
    "benchmark": ("workers", "shard"),
    "choices": ("workers", "shard", "seed", "time_limit", "experiment."),
    "tune": ("time_limit", "trial_seed", "problems_per_scene"),
    "voxels": ("perception.voxels.shell.1",),  # see test_thickness_of_the_shell_is_a_number
}


@pytest.mark.parametrize("stage", [stage for stage in STAGES if "profile" in choices_of(stage)])
def test_no_number_may_be_nan_or_negative(stage):
    """Whichever number of a configuration is NaN, or whichever integer negative, it is refused when converted."""
    plain = OmegaConf.to_container(compose(stage), resolve=True)
    convert_all(stage, plain)
    accepted = []
    for where, value in leaves(plain):
        bad = {float: float("nan"), int: -2}.get(type(value))
        if bad is None:
            continue
        # Adherence methods compile functions: made only where their own numbers are tried.
        skip = () if "adherence" in str(where) else ("adherence", "adherences")
        try:
            convert_all(stage, changed(plain, where, bad), skip)
        except ConfigError as error:
            assert "\n" not in str(error)
        else:
            accepted.append(".".join(map(str, where)))
    assert [name for name in accepted if not name.startswith(LATER.get(stage, ()))] == []


@pytest.mark.parametrize("scale", [ScenesScale, TrainScale, BenchmarkScale, ChoicesScale])
def test_scales_are_positive(scale):
    """A profile's number of anything must be above 0; which one is not is named with its section."""
    section = scale.__name__.removesuffix("Scale").lower()
    numbers = [f.name for f in fields(scale) if f.name != "others"]
    for name in numbers:
        for value in (0, -1):
            with pytest.raises(ConfigError, match=rf"profile\.{section}\.{name} is {value}; it must be above 0"):
                scale(**{other: value if other == name else 1 for other in numbers})
    if len(numbers) < len(fields(scale)):
        with pytest.raises(ConfigError, match=rf"profile\.{section}\.others\.bands is 0; it must be above 0"):
            scale(**dict.fromkeys(numbers, 1), others={"bands": 0})


def test_thickness_of_the_shell_is_a_number():
    """A shell whose thickness is NaN, which would leave every voxel grid empty, is refused."""
    with pytest.raises(ConfigError, match="shell"):
        convert_all("voxels", compose("voxels", ["perception.voxels.shell=[1.0,nan]"]))


def test_fallback_is_the_classical_sampler():
    """What the learned sampler falls back to has the parameters that the classical one is configured with."""
    given = OmegaConf.to_container(OmegaConf.load(CONF / "sampler" / "uniform.yaml"))
    assert asdict(UniformParameters()) == {**given["parameters"], "directions": False}


def test_sampling_as_algorithm_6_has_nothing_of_ours():
    """One sample per proposal and nothing beside it, and a whole first batch by the network."""
    method = compose("benchmark").experiment.methods.algorithm6_fmt
    sampler, planner = method.sampler.parameters, method.planner.parameters
    assert (sampler.points, sampler.spread) == (1, 0)
    assert (sampler.from_start, sampler.from_goal, sampler.arrive) == (0, 0, 0)
    assert sampler.n_ismp * sampler.batch >= 5 * planner.samples  # even where four of five proposals are in collision


def test_the_tuned_baseline_differs_from_the_papers_by_what_was_tuned():
    """What the choices stage varies may differ from the paper's FMT*; what it does not vary is the same."""
    methods, tried = compose("benchmark").experiment.methods, compose("choices").variants
    tuned, papers = methods.fmt_tuned, methods.fmt
    assert tuned.planner.parameters.samples != papers.planner.parameters.samples
    for part in ("planner", "sampler"):
        varied = {name for variant in tried if variant.base == "fmt" for name in (variant.get(part) or {})}
        own, paper = tuned[part].parameters, papers[part].parameters
        assert tuned[part].kind == papers[part].kind and own.keys() == paper.keys()
        assert {name for name in own if own[name] != paper[name]} <= varied


@pytest.mark.parametrize("environment", files_of("environment"))
def test_a_cross_has_every_planner_with_both_samplers(environment):
    """Each planner is there once with each sampler, and every learned method is held against its classical one."""
    composed = compose("benchmark", [f"environment={environment}", f"experiment=cross/{environment}"])
    found = load(composed.experiment, Experiment)
    pairs = {(method.planner.kind, method.sampler.kind): method for method in found.methods.values()}
    assert set(pairs) == set(product(("fmt", "rrt", "rrtconnect"), ("uniform", "compnetx"))) and len(found.methods) == 6
    for (planner, sampler), method in pairs.items():
        against = [found.methods[key] for key in method.compared_with]
        assert against == ([pairs[planner, "uniform"]] if sampler == "compnetx" else [])
    assert len(found.adherences) == 3
