"""Study of the paper of Wu et al.: networks, Tables I to III, trainings by rewards, and test flights.

Each step is an ordinary command and each result a file, so a study that was stopped resumes where it was.
The order is that of the paper, and trainings run seed by seed: a stopped study has some of each condition.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from hydro.core.effects.damping import LINEAR_DAMPING, QUADRATIC_DAMPING
from hydro.study import policies
from hydro.study.policies import Run
from hydro.study.steps import Step

NETWORKS = ("mlp", "resmlp", "multihead", "moe", "physfeat")
"""Architectures of Table I."""
PROTOCOLS = ("paper", "annealed")
"""Training protocols of the networks; policies are trained with networks of the first protocol."""
CONDITIONS = ("R_PhysFeat", "R_MLP", "R_0+M_A", "R_effects", "R_identified", "R_0")
"""Physics of the trainings, the paper's most important comparison first."""
IDENTIFIED_EFFECTS = (LINEAR_DAMPING.name, QUADRATIC_DAMPING.name)
"""Effects that are fitted for `R_identified`."""
PIECE = "10"
"""Length of a segment of the paper's replay sequence [s]."""


class Replay(NamedTuple):
    """Settings for one way of replaying networks.

    Attributes:
        conditioning: Name of the filter and limits of the network's wrench.
        lead: Time by which the network is evaluated ahead, in control steps.
    """

    conditioning: str
    lead: float

    @property
    def name(self) -> str:
        """Part of a file's name that tells this way of replaying from others, such as `off-lead0.5`."""
        return f"{self.conditioning}-lead{self.lead:g}"


REPLAYS = (Replay("paper-old", 0.0), Replay("paper-new", 0.0), Replay("off", 0.0), Replay("off", 0.5))
"""Replays of Table III.  The paper evaluates without lead and gives beta = 0.9 without the definition."""


@dataclass(frozen=True)
class Study:
    """Settings of a study that repeats the experiment of Deep Hydro-Sim (Wu et al.).

    Attributes:
        folder: Folder of the study.
        raw: Recording from which networks learn and damping is identified.
        replay: Recording of the replayed sequence.
        vehicle: Vehicle file of all conditions except the two with effects.
        given: Vehicle file with effects that were chosen without data, for `R_effects`.
        networks: Names of the networks' architectures.
        protocols: Names of the ways in which networks are trained.
        replays: Ways of replaying the networks.
        epochs: Greatest number of epochs of a network; None for the default.
        conditions: Names of the water models in which policies are trained, such as `R_PhysFeat`.
        seeds: Number of trainings of a policy under each condition.
        stages: Last stage of the curriculum.
        steps: Control steps of each training at most; the budget is equal for all.
        episodes: Episodes of each test.
        recipe: Name of the settings of the trainings.
        choices: Other settings of every training, as `NAME=VALUE`.
    """

    folder: Path
    raw: Path
    replay: Path
    vehicle: Path
    given: Path | None = None
    networks: tuple[str, ...] = NETWORKS
    protocols: tuple[str, ...] = PROTOCOLS
    replays: tuple[Replay, ...] = REPLAYS
    epochs: int | None = None
    conditions: tuple[str, ...] = CONDITIONS
    seeds: int = 5
    stages: int = 3
    steps: int = 800_000
    episodes: int = 100
    recipe: str = "sac"
    choices: tuple[str, ...] = ("wrench.lead=0",)

    def network(self, model: str, protocol: str) -> Path:
        """Return the path of the file of an architecture's network, trained in one of `protocols`.

        Args:
            model: Name of the architecture.
            protocol: Name of the way of training.
        """
        return self.folder / "models" / f"{model}-{protocol}.parquet"

    @property
    def identified(self) -> Path:
        """Path of the vehicle file with identified damping, whether it exists or not."""
        return self.folder / "identified.toml"

    def offline(self, protocol: str) -> Path:
        """Return the path of the table of the networks' prediction errors (Table II of Wu et al.).

        Args:
            protocol: Name of the way in which the networks were trained.
        """
        return self.folder / f"offline-{protocol}.parquet"

    def replayed(self, protocol: str, way: Replay) -> Path:
        """Return the path of the table of the networks' replay errors (Table III of Wu et al.).

        Args:
            protocol: Name of the way in which the networks were trained.
            way: Way of replaying.
        """
        return self.folder / f"replay-{protocol}-{way.name}.parquet"

    @property
    def policies(self) -> policies.Study:
        """Settings of the part of the study that trains and tests policies."""
        from hydro.rl.environment.conditions import EFFECTS, IDENTIFIED, MODELS

        wanted = {MODELS[name] for name in self.conditions if name in MODELS}
        names = [name for name in self.conditions if name != EFFECTS or self.given is not None]
        return policies.Study(
            self.folder,
            self.vehicle,
            models=tuple(self.network(name, self.protocols[0]) for name in self.networks if name in wanted),
            identified=self.identified if IDENTIFIED in names else None,
            given=self.given,
            conditions=tuple(names),
            seeds=self.seeds,
            stages=self.stages,
            steps=self.steps,
            episodes=self.episodes,
            recipe=self.recipe,
            choices=self.choices,
            last=True,
        )


def runs(study: Study) -> list[Run]:
    """Return the trainings of policies, seed by seed; the files of their networks need not exist yet.

    Args:
        study: The study.
    """
    from hydro.rl.environment.conditions import EFFECTS, IDENTIFIED, MODELS

    known = study.policies
    vehicles = dict.fromkeys(known.conditions, study.vehicle)
    vehicles |= {IDENTIFIED: study.identified, EFFECTS: study.given or study.vehicle}
    return [
        Run(
            name,
            seed,
            study.folder / f"{name}-seed{seed}",
            vehicles[name],
            study.network(MODELS[name], study.protocols[0]) if name in MODELS else None,
        )
        for seed in range(study.seeds)
        for name in known.conditions
    ]


def steps(study: Study) -> list[Step]:
    """Return all commands (steps) of a study, not yet run, in the order in which they are run.

    Networks that the trainings need come first, then the trainings of policies with their tests, then the
    other tables.

    Args:
        study: The study.
    """
    of_trainings, others = _networks(study)
    trainings = policies.steps(study.policies, runs(study))
    first = next((k for k, step in enumerate(trainings) if study.identified in step.reads), 0)
    return [
        *_labels(study),
        *of_trainings,
        *trainings[:first],
        *_identification(study),
        *trainings[first:],
        *others,
        *(step for protocol in study.protocols for step in _tables(study, protocol)),
    ]


def _labels(study: Study) -> list[Step]:
    """Return the steps that label and split the recording."""
    labels, split = study.folder / "labels.parquet", study.folder / "split.parquet"
    line = ("labels", str(study.raw), "--vehicle", str(study.vehicle), "-o", str(labels))
    return [
        Step(line, (study.raw, study.vehicle), (labels,)),
        Step(("split", str(labels), "-o", str(split)), (labels,), (split,)),
    ]


def _networks(study: Study) -> tuple[list[Step], list[Step]]:
    """Return the steps that train networks: those that policies are trained with, and all others."""
    from hydro.rl.environment.conditions import MODELS

    needed = {MODELS[name] for name in study.conditions if name in MODELS}
    split = study.folder / "split.parquet"
    first, others = list[Step](), list[Step]()
    for protocol in study.protocols:
        for model in study.networks:
            target = study.network(model, protocol)
            limit = () if study.epochs is None else ("--epochs", str(study.epochs))
            line = ("train", str(split), "--model", model, "--protocol", protocol, *limit, "-o", str(target))
            step = Step(line, (split,), (target,), ("train", model, protocol))
            used = protocol == study.protocols[0] and model in needed
            (first if used else others).append(step)
    return first, others


def _identification(study: Study) -> list[Step]:
    """Return the step that identifies damping from the recording."""
    from hydro.rl.environment.conditions import IDENTIFIED

    if IDENTIFIED not in study.conditions:
        return []
    effects = [word for name in IDENTIFIED_EFFECTS for word in ("--effect", name)]
    line = ("fit", str(study.vehicle), str(study.raw), *effects, "-o", str(study.identified))
    return [Step(line, (study.vehicle, study.raw), (study.identified,))]


def _tables(study: Study, protocol: str) -> list[Step]:
    """Return the steps of Tables II and III for the networks of a protocol."""
    models = [study.network(name, protocol) for name in study.networks]
    split, offline = study.folder / "split.parquet", study.offline(protocol)
    names = [str(model) for model in models]
    found = [
        Step(
            ("evaluate", *names, "--labels", str(split), "--part", "test", "-o", str(offline)),
            (*models, split),
            (offline,),
        )
    ]
    given = [word for name in names for word in ("--model", name)]
    for way in study.replays:
        target = study.replayed(protocol, way)
        line = ("replay", str(study.replay), "--vehicle", str(study.vehicle), *given, "--piece", PIECE)
        ways = ("--conditioning", way.conditioning, "--lead", f"{way.lead:g}", "--metrics", str(target))
        found.append(
            Step((*line, *ways, "-o", "/dev/null"), (*models, study.replay, study.vehicle), (target,))
        )
    return found


def quick(study: Study) -> Study:
    """Return a copy of a study that takes a few seconds with the same steps, for tests of the command.

    Args:
        study: The study.
    """
    from dataclasses import replace

    small = ("vehicles=8", "record=80", "evaluate=160", "episodes=4", "pilot=0", "settings.task.steps=20")
    learner = ("sac.layers=[16,16]", "sac.batch=16", "sac.random=80", "sac.capacity=1000", "sac.horizon=3")
    exams = ("curriculum.window=4", "curriculum.row=[2]", "curriculum.examine=160")
    return replace(
        study,
        networks=("mlp", "physfeat"),
        protocols=PROTOCOLS[:1],
        replays=REPLAYS[:1],
        epochs=1,
        conditions=("R_PhysFeat", "R_0+M_A"),
        seeds=1,
        steps=320,
        episodes=2,
        choices=(*study.choices, *small, *learner, *exams),
    )


def finished(study: Study, of: Sequence[Run]) -> list[Run]:
    """Return those of the given trainings whose tests are all complete.

    Args:
        study: The study.
        of: Trainings of policies.
    """
    tests = policies.tests(study.policies)
    return [run for run in of if all(run.tested(*test).is_file() for test in tests)]
