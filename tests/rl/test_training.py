"""Training runs: bit-exact resumption after a kill, passing of levels, and stored results."""

from dataclasses import replace
from itertools import pairwise

import msgspec
import numpy as np
import polars as pl
import pytest
from scipy.spatial.distance import cdist

from hydro.core.errors import DataError, UsageError
from hydro.io import table
from hydro.io import vehicle as vehicles
from hydro.rl.environment.helmsman import helmsman
from hydro.rl.training.build import Builder
from hydro.rl.training.config import RECIPES, Curriculum, SACConfig, TrainingConfig
from hydro.rl.training.demonstrations import demonstrations
from hydro.rl.training.evaluate import alternating, fly, interval, summary, trace
from hydro.rl.training.runs import Folder, changed, config_of, policy_of, run_artefact
from hydro.rl.training.train import Training
from hydro.rl.world.config import Episode, Randomisation, Settings

SHORT = Settings(task=Episode(steps=10))
QUICK = TrainingConfig(
    vehicles=4,
    record=40,
    evaluate=80,
    episodes=3,
    sac=SACConfig(layers=(16,), batch=16, capacity=300, random=40),
    settings=SHORT,
)
TABLES = ("run.parquet", "curves.parquet", "evaluations.parquet", "policy.parquet", "checkpoint.pt")
EVERYWHERE = replace(SHORT, task=Episode(steps=10, radius=100.0))  # every episode succeeds at its first step


@pytest.fixture(scope="module")
def auv151(datasets):
    return vehicles.read(datasets / "vehicles" / "auv151.toml")


def train(path, config, auv151, evaluations=1000):
    """Train in a folder, up to a number of evaluations."""
    vehicle, text = auv151
    folder, run = Folder(path), run_artefact(config, text, None)
    state = folder.state(run)
    training = Training(config, Builder(config, vehicle))
    folder.begin(run, None)
    if state is not None:
        training.restore(state)
    while not training.finished and evaluations:
        training.advance()
        folder.save(training, run)
        evaluations -= 1
    return training


CORRECTED = {"demonstrations": 3, "clone": 5, "corrections": 9}
DRAWN = replace(SHORT, history=2, randomise=Randomisation(box=0.1, current=0.2, load=0.1, late=0.04))


@pytest.mark.parametrize(
    "shown",
    [{}, {"demonstrations": 3, "clone": 5}, CORRECTED, {"settings": DRAWN}],
    ids=["alone", "shown", "corrected", "of drawn vehicles"],
)
def test_going_on_after_a_kill_gives_the_bytes_of_never_having_stopped(tmp_path, auv151, shown):
    """The steps exceed the memory, so the kill comes after it was overwritten."""
    config = replace(QUICK, steps=480, **shown)
    train(tmp_path / "straight", config, auv151)
    killed = train(tmp_path / "broken", config, auv151, evaluations=4)
    killed.advance()  # not saved: this is what the kill takes away
    assert train(tmp_path / "broken", config, auv151).steps >= 480
    for name in TABLES:
        assert (tmp_path / "broken" / name).read_bytes() == (tmp_path / "straight" / name).read_bytes(), name


def test_more_steps_and_stages_go_on_beyond(tmp_path, auv151):
    train(tmp_path / "straight", replace(QUICK, steps=320, curriculum=Curriculum(last=2)), auv151)
    assert train(tmp_path / "longer", replace(QUICK, steps=160), auv151).finished
    train(tmp_path / "longer", replace(QUICK, steps=320, curriculum=Curriculum(last=2)), auv151)
    for name in TABLES:
        assert (tmp_path / "longer" / name).read_bytes() == (tmp_path / "straight" / name).read_bytes(), name


def test_a_training_begins_with_what_another_has_learnt(tmp_path, auv151):
    """The other policy acts from the first step under new physics, with the other critics."""
    train(tmp_path / "first", replace(QUICK, steps=80), auv151)
    folder, (vehicle, _) = Folder(tmp_path / "first"), auv151
    config = replace(QUICK, condition="R_0", seed=3, steps=QUICK.vehicles)
    second = Training(config, Builder(config, vehicle), learnt=folder.learnt())
    observations = np.random.default_rng(0).standard_normal((4, 36)).astype(np.float32)
    np.testing.assert_array_equal(second.policy()(observations), folder.policy()[0](observations))
    drawn = second._learner.act(second._observations)
    fresh = Training(config, Builder(config, vehicle), learnt=folder.learnt())
    fresh.advance()
    np.testing.assert_allclose(fresh._learner._horizon.state()[-1].actions, drawn)
    assert fresh.curriculum.passed == []
    other = replace(config, sac=replace(config.sac, layers=(8,)))
    with pytest.raises(DataError, match=r"other layers: give its sac\.layers"):
        Training(other, Builder(other, vehicle), learnt=folder.learnt())
    with pytest.raises(DataError, match=r"no checkpoint\.pt to start from"):
        Folder(tmp_path / "nothing").learnt()


def test_other_choices_are_another_training(tmp_path, auv151):
    train(tmp_path, replace(QUICK, steps=80), auv151)
    with pytest.raises(DataError, match=r"other sac\.batch: give another folder"):
        train(tmp_path, replace(QUICK, steps=80, sac=replace(QUICK.sac, batch=8)), auv151)
    vehicle, text = auv151
    with pytest.raises(DataError, match="other inputs"):
        train(tmp_path, replace(QUICK, steps=80), (vehicle, text.replace("mass = 151.0", "mass = 150.0")))
    (tmp_path / "checkpoint.pt").write_bytes(b"broken")
    with pytest.raises(DataError, match="remove it to train again"):
        train(tmp_path, replace(QUICK, steps=80), auv151)


def test_a_run_of_another_version_is_told_by_the_choices_it_lacks(auv151):
    run = run_artefact(QUICK, auv151[1], None)
    older = replace(run, frame=run.frame.filter(pl.col("name") != "settings.sonar.crowding"))
    with pytest.raises(DataError, match=r"not a training of this version: setting settings\.sonar\.crowding"):
        config_of(older)


def test_the_curriculum_is_passed_to_its_end(tmp_path, auv151):
    levels = Curriculum(last=3, baffles=(0, 4), pillars=8, window=8)
    config = replace(QUICK, steps=4000, curriculum=levels, settings=EVERYWHERE)
    training = train(tmp_path, config, auv151)
    assert training.curriculum.done
    assert training.steps < 400
    evaluations = Folder(tmp_path).evaluations().frame
    exams = evaluations.filter(purpose="exam")
    assert exams.select("task", "level").rows() == [
        ("point_to_point", 0), ("slalom", 0), ("slalom", 4), ("forest", 8)
    ]  # fmt: skip
    assert (exams["success"] == 1.0).all()


def test_what_passed_a_task_is_kept_as_it_was(tmp_path, auv151):
    """The policy of each task is that of its last examination, whatever is learnt afterwards."""
    levels = Curriculum(last=2, baffles=(0, 4), window=30)
    config = replace(QUICK, steps=4000, curriculum=levels, settings=EVERYWHERE)
    for _ in range(10):  # stopped after every evaluation
        training = train(tmp_path, config, auv151, evaluations=1)
    assert training.curriculum.done
    folder = Folder(tmp_path)
    exams = (
        folder.evaluations()
        .frame.filter(purpose="exam")
        .rows_by_key(["task", "level"], named=True, unique=True)
    )
    kept = {task: folder.policy(task)[0] for task in ("point_to_point", "slalom")}
    for task, level in (("point_to_point", 0), ("slalom", 4)):
        assert kept[task].training["steps"] == exams[task, level]["steps"]
        assert (kept[task].training["task"], kept[task].training["level"]) == (task, level)
    last, _ = folder.policy()
    assert not np.array_equal(kept["point_to_point"].weights["0.0.weight"], last.weights["0.0.weight"])
    other, _ = folder.policy("docking")  # nobody passed it: what was learnt last
    assert all(np.array_equal(other.weights[name], each) for name, each in last.weights.items())


def test_a_pilot_shows_the_way_past_pillars_that_the_policy_does_not_see_on_a_map(auv151):
    """The target of the observation in the slalom is the goal, and yet the expert arrives."""
    fleet = Builder(TrainingConfig(), auv151[0])(4, 5)
    fleet.set_level("slalom", 4)
    steps = list(demonstrations(fleet))
    assert len(steps) == 1000
    ended = np.array([step.ended for step in steps])
    arrived = np.array([step.rewards for step in steps]) > 10.0
    assert arrived.sum() >= 0.9 * ended.sum() > 0
    first = steps[0].observations[:, :3]
    assert (np.linalg.norm(first, axis=1) > 21.0).all()  # from one end of the tank to the other


def test_what_a_pilot_shows_may_pass_a_level_without_learning(tmp_path, auv151):
    levels = Curriculum(last=2, baffles=(0,), window=4, share=0.5)
    config = replace(
        RECIPES["imitation"],
        demonstrations=8,
        clone=800,
        steps=4001,
        curriculum=levels,
        record=80,
        evaluate=80,
    )
    training = train(tmp_path, replace(config, settings=Settings()), auv151)
    assert training.curriculum.passed == [("point_to_point", 0), ("slalom", 0)]
    assert training.steps == 8 * 500  # his flights; what he showed in open water passes the slalom's at once
    assert (Folder(tmp_path).evaluations().frame["steps"] == 8 * 500).all()


def test_examinations_may_come_by_a_schedule(tmp_path, auv151):
    levels = Curriculum(examine=120, window=4)
    train(tmp_path, replace(QUICK, steps=400, curriculum=levels), auv151)
    exams = Folder(tmp_path).evaluations().frame.filter(purpose="exam")
    assert exams["steps"].to_list() == [120, 240, 360]


def test_tables_say_where_they_come_from(tmp_path, auv151):
    vehicle, _ = auv151
    config = replace(QUICK, steps=80)
    training = train(tmp_path, config, auv151)
    folder = Folder(tmp_path)
    assert config_of(folder.run()) == folder.config() == config
    policy, artefact = folder.policy()
    kinds = [each.kind for each in artefact.provenance.inputs]
    assert kinds == ["run"]
    assert [each.kind for each in artefact.provenance.inputs[0].inputs] == ["vehicle"]
    assert policy_of(table.read(tmp_path / "policy.parquet")).training["steps"] == 80
    provenance = msgspec.structs.replace(
        artefact.provenance, model={k: v for k, v in artefact.provenance.model.items() if k != "fades"}
    )
    with pytest.raises(DataError, match="an earlier version wrote it: train again with"):
        policy_of(replace(artefact, provenance=provenance))
    for name, junk in (("widths", ["x"]), ("widths", [2**53]), ("training", {"task": [1]}), ("training", 3)):
        said = {**(artefact.provenance.model or {}), name: junk}
        with pytest.raises(DataError, match=rf"at `\$\.{name}.*train again with"):
            policy_of(replace(artefact, provenance=msgspec.structs.replace(artefact.provenance, model=said)))
    fleet = Builder(config, vehicle)(3, 7)
    assert fly(policy, fleet).equals(fly(training.policy(), Builder(config, vehicle)(3, 7)))


def test_choices_are_made_by_name():
    config = changed(
        TrainingConfig(), {"sac.layers": "[64, 64]", "settings.task.radius": "0.4", "condition": '"R_0"'}
    )
    assert (config.sac.layers, config.settings.task.radius, config.condition) == ((64, 64), 0.4, "R_0")
    with pytest.raises(UsageError, match=r"no choice is called 'sac\.size': choose one of sac\."):
        changed(TrainingConfig(), {"sac.size": "3"})
    with pytest.raises(UsageError, match=r"sac\.batch=.*: not a value"):
        changed(TrainingConfig(), {"sac.batch": '"big"'})
    with pytest.raises(UsageError, match="each must be a multiple"):
        changed(TrainingConfig(), {"vehicles": "7"})


def test_choices_and_runs_of_the_version_before_keep_their_names(auv151):
    """The old name `ladder` is accepted for `curriculum`."""
    assert changed(TrainingConfig(), {"ladder.ready": "0.8"}).curriculum.ready == 0.8
    config = replace(QUICK, curriculum=Curriculum(last=2, ready=0.7))
    run = run_artefact(config, auv151[1], None)
    older = replace(run, frame=run.frame.with_columns(pl.col("name").str.replace("^curriculum", "ladder")))
    assert not older.frame.equals(run.frame)
    assert config_of(older) == config


def test_the_same_tasks_are_flown_in_both_simulators(auv151):
    vehicle, _ = auv151

    def still(observations):
        return 0.0 * observations[:, :6]

    build = Builder(QUICK, vehicle)
    student, teacher = (fly(still, build(4, 5, where)) for where in ("student", "teacher"))
    places = [name for name in student.columns if name.startswith(("start", "goal"))]
    assert student.select(places).equals(teacher.select(places))
    assert set(student["outcome"]) == set(teacher["outcome"]) == {"time"}
    assert student["duration"].to_list() == [pytest.approx(10 * 0.04)] * 4
    assert summary(student)["success"] == 0.0
    assert summary(student)["time_to_goal"] is None


def test_arrivals_are_counted(auv151):
    vehicle, _ = auv151
    config = replace(QUICK, settings=EVERYWHERE)
    found = summary(fly(lambda observations: observations[:, :6], Builder(config, vehicle)(5, 0)))
    assert found["success"] == 1.0
    assert found["time_to_goal"] == pytest.approx(0.04)


def test_an_examination_ends_with_the_failure_that_decides_it(auv151):
    """Episodes before the end equal those without an early end; a passable examination runs completely."""
    fleets = Builder(TrainingConfig(), auv151[0])

    def flown(spare):
        fleet = fleets(12, 5)
        fleet.set_level("slalom", 1)
        return fly(helmsman, fleet, spare)

    whole, stopped = flown(None), flown(2)
    failed = whole.filter(pl.col("outcome") != "success").sort("duration")
    last = failed["duration"][2]
    assert failed.height > 3
    assert stopped["episode"].to_list() == whole.filter(pl.col("duration") <= last)["episode"].to_list()
    same = [name for name in whole.columns if name != "tracking_error"]
    assert stopped.select(same).equals(whole.filter(pl.col("duration") <= last).select(same))
    assert flown(failed.height).equals(whole)


@pytest.mark.parametrize(
    ("share", "window", "spare"), [(0.97, 150, 4), (1.0, 8, 0), (0.5, 4, 2), (0.9, 10, 1)]
)
def test_as_many_may_fail_as_the_share_leaves(share, window, spare):
    assert Curriculum(share=share, window=window).spare == spare
    assert (window - spare) / window >= share > (window - spare - 1) / window


def way(*points):
    """Return a flight along straight lines between points north and east, at a depth of 5 m."""
    legs = [np.linspace(a, b, 50) for a, b in pairwise(points)]
    return np.column_stack([np.vstack(legs), np.full(50 * len(legs), 5.0)])


SLALOM = np.array([[9.0, 0.6], [5.0, 0.6], [7.0, -0.6], [np.nan, np.nan]])


@pytest.mark.parametrize(
    ("flown", "share"),
    [
        (way((0.0, 0.0), (12.0, 0.0)), 1.0),
        (way((12.0, 0.0), (0.0, 0.0)), 1.0),
        (way((0.0, 3.0), (12.0, 3.0)), 0.0),
        (way((0.0, 0.0), (8.0, 0.0), (8.0, 3.0), (12.0, 3.0)), 0.5),
        (way((0.0, 0.0), (8.0, 0.0)), 1.0),
        (way((0.0, 0.0), (6.0, 0.0)), None),
    ],
)
def test_pillars_passed_on_alternating_sides_are_counted(flown, share):
    assert alternating(flown, SLALOM) == share


def test_off_the_way_is_measured_as_it_was_flown(auv151):
    """Path deviation equals the densely sampled distance from the planned path."""
    vehicle, _ = auv151
    config = replace(QUICK, settings=Settings())
    told = fly(helmsman, led(config, vehicle, 2))["tracking_error"].to_list()
    flight = trace(helmsman, led(config, vehicle, 1))
    corners = [np.linspace(a, b, 2000) for a, b in pairwise(flight.way)]
    off = cdist(flight.pose[1:, :3], np.vstack(corners)).min(axis=1)
    assert told[0] == pytest.approx(np.sqrt((off**2).mean()), rel=0.02)


def led(config, vehicle, count):
    fleet = Builder(config, vehicle)(count, 3)
    fleet.set_level("forest", 8)
    return fleet


def test_intervals_are_wilsons():
    """Check centre and half width of Wilson's score interval for 190 of 200, z = 1.96."""
    low, high = interval(190, 200)
    z, p, n = 1.959964, 0.95, 200
    centre, half = p + z**2 / (2 * n), z * (p * (1 - p) / n + z**2 / (4 * n**2)) ** 0.5
    assert (low, high) == pytest.approx(((centre - half) / (1 + z**2 / n), (centre + half) / (1 + z**2 / n)))


@pytest.mark.parametrize(("task", "planned"), [("pillar_row", False), ("forest", True)])
def test_a_flight_is_kept_with_its_scene(auv151, task, planned):
    vehicle, _ = auv151
    fleet = Builder(QUICK, vehicle)(1, 3)
    fleet.set_level(task, 6)
    flight = trace(lambda observations: observations[:, :6], fleet)
    assert flight.pose.shape == (len(flight.t), 7)
    assert flight.pillars.shape == (6, 2)
    assert (len(flight.way) > 1) == planned
    if planned:
        assert flight.way[-1] == pytest.approx(flight.goal)
        assert flight.way[0] == pytest.approx(flight.pose[0, :3])


def test_a_run_from_before_there_were_engines_keeps_flying_in_mujoco(auv151):
    run = run_artefact(TrainingConfig(), auv151[1])
    assert config_of(run).settings.engine == "kernels"
    assert run.provenance.parameters["engine"] == "kernels"
    before = replace(run, frame=run.frame.filter(~pl.col("name").is_in(["settings.engine", "settings.step"])))
    assert config_of(before).settings.engine == "mujoco"
