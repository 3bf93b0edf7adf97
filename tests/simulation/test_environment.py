"""The Gymnasium environment: its own checker, seeds, masks, the shield, and how episodes end."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import test_memory
import zoo

import sdhj
from sdhj.certified import Certified
from sdhj.table.batches import Table

gymnasium = pytest.importorskip("gymnasium", reason="Gymnasium is not installed: pip install 'sdhj[gym]'")
from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium.utils.passive_env_checker import env_reset_passive_checker, env_step_passive_checker  # noqa: E402

from sdhj.simulation.environment import ReachAvoidEnv  # noqa: E402


@cache
def certified_line() -> Table:
    return sdhj.solve(zoo.interval_problem(), Certified((80,)), progress=False)


TABLES: dict[str, Any] = {"line": zoo.interval_table, "torus": zoo.torus_table, "certified": certified_line}


@pytest.mark.parametrize(("name", "shield"), [("line", True), ("torus", True), ("certified", False)])
def test_gymnasiums_own_checker_finds_nothing(name: str, shield: bool) -> None:
    """No error, and of its warnings only that there is no other render mode to try."""
    with pytest.warns(UserWarning) as told:
        check_env(ReachAvoidEnv(TABLES[name](), shield=shield))
    assert [str(one.message) for one in told if "render modes" not in str(one.message)] == []


def played(env: Any, actions: np.random.Generator, masked: bool, seed: int | None = None, **options: Any) -> list[Any]:
    """One episode: (observation, reward, terminated, truncated, info) of each step, the reset's first."""
    observation, info = env_reset_passive_checker(env, seed=seed, options=options or None)
    steps = [(observation, 0.0, False, False, info)]
    while not (steps[-1][2] or steps[-1][3]):
        allowed = np.flatnonzero(steps[-1][4]["action_mask"]) if masked else np.arange(env.action_space.n)
        steps.append(env_step_passive_checker(env, actions.choice(allowed)))
    return steps


@pytest.mark.parametrize("name", ["line", "certified"])
def test_a_seed_fixes_the_episode(name: str) -> None:
    first, again, other = (
        played(ReachAvoidEnv(TABLES[name]()), np.random.default_rng(1), True, seed) for seed in (5, 5, 6)
    )
    assert len(first) == len(again) > 1
    for one, two in zip(first, again, strict=True):
        np.testing.assert_array_equal(one[0], two[0])
        assert one[1:4] == two[1:4]
    assert not np.array_equal(first[0][0], other[0][0])


@pytest.mark.slow
@pytest.mark.parametrize("adversary", ["random", "worst"])
@pytest.mark.parametrize(("shield", "masked"), [(True, False), (False, True)])
def test_behind_the_shield_or_its_mask_every_certified_episode_arrives(
    adversary: str, shield: bool, masked: bool
) -> None:
    """A random agent: where every action is safe, the promise of the table is kept whatever it does."""
    env, actions = ReachAvoidEnv(certified_line(), adversary, shield=shield), np.random.default_rng(2)
    overruled = 0
    for seed in range(40):
        steps = played(env, actions, masked, seed)
        assert steps[-1][4]["outcome"] == "reached" and steps[-1][1:4] == (1.0, True, False)
        assert all(info["promised"] for *_, info in steps)
        assert [step[0][-1] for step in steps] == list(range(len(steps)))
        overruled += sum(info["overruled"] for *_, info in steps[1:])
        assert abs(steps[0][0][0]) > 1  # episodes begin outside the target
    assert (overruled > 0) == shield


@pytest.mark.slow
def test_without_either_episodes_end_in_every_way() -> None:
    env, actions = ReachAvoidEnv(zoo.interval_table(), shield=False), np.random.default_rng(3)
    ends = [played(env, actions, False, seed)[-1] for seed in range(150)]
    told = {info["outcome"]: (reward, terminated, truncated) for _, reward, terminated, truncated, info in ends}
    assert told == {"reached": (1.0, True, False), "collided": (-1.0, True, False), "late": (0.0, False, True)}
    assert not any(info["overruled"] for *_, info in ends)


def test_the_mask_is_what_the_filter_leaves_alone() -> None:
    env, table = ReachAvoidEnv(zoo.interval_table(), "none"), zoo.interval_table()
    controller = sdhj.Controller(table)
    for q in np.linspace(-3.9, 3.3, 37):
        _, info = env.reset(options={"state": [q]})
        told = controller.filter(np.full((3, 1), q), 0, np.arange(3))
        np.testing.assert_array_equal(info["action_mask"] == 1, ~told.changed)
        assert info["action_mask"].dtype == np.int8 and env.action_space.sample(info["action_mask"]) in range(3)
        assert info["promised"] == told.promised.all()


def test_off_the_grid_is_the_end() -> None:
    """What is observed then is the nearest place on it."""
    table = sdhj.solve(zoo.interval_problem(ends="unsafe", steps=8), progress=False)
    env = ReachAvoidEnv(table, "none", shield=False)
    env.reset(options={"state": [-3.8]})
    observation, reward, terminated, truncated, info = env.step(np.int64(0))
    assert observation.tolist() == [-4.0, 1.0] and observation in env.observation_space
    assert (reward, terminated, truncated, info["outcome"]) == (-1.0, True, False, "off the grid")
    assert info["action_mask"].all() and not info["promised"]


def test_guards() -> None:
    env = ReachAvoidEnv(zoo.interval_table())
    with pytest.raises(ValueError, match=r"is over; call reset\(\)"):
        env.step(np.int64(0))
    env.reset(seed=0)
    for action in (3, -1, 0.5):
        with pytest.raises(ValueError, match="from 0 to 2"):
            env.step(action)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"options\['state'\] must have shape"):
        env.reset(options={"state": [0.0, 0.0]})
    with pytest.raises(ValueError, match="adversary"):
        ReachAvoidEnv(zoo.interval_table(), "nobody")
    with pytest.raises(ValueError, match="table must be what"):
        ReachAvoidEnv(zoo.interval_problem())  # type: ignore[arg-type]


@cache
def sensed_line(memory: bool) -> Table:
    """On the line, measured with errors, late and by an uncertain clock."""
    sensing = sdhj.Sensing(0.05, 0.1, 0.02, memory=memory)
    return sdhj.solve(replace(zoo.interval_problem(), sensing=sensing), Certified((80,)), progress=False)


@pytest.mark.slow
@pytest.mark.parametrize("adversary", ["random", "worst"])
@pytest.mark.parametrize("memory", [False, True])
def test_an_agent_that_measures_is_shown_what_the_controller_knows(adversary: str, memory: bool) -> None:
    """The observation is within E of the state, and behind the shield every episode arrives."""
    table, actions = sensed_line(memory), np.random.default_rng(4)
    env, box = ReachAvoidEnv(table, adversary), table.problem.half_widths[0]
    for seed in range(20):
        observation, info = env.reset(seed=seed)
        while not info["outcome"]:
            assert info["promised"] and (np.abs(observation[:-1] - env.runs.states[0]) <= box + 1e-9).all()
            observation, *_, info = env.step(actions.integers(0, 3))
        assert info["outcome"] == "reached"


@pytest.mark.slow
def test_the_point_is_carried_on() -> None:
    """At 100 Hz, where a measurement alone keeps no promise: the mask is that of the point, clipped as `step` does."""
    table = test_memory.solved(0.01, cells=(100, 100), steps=60)
    env, controller, differs = ReachAvoidEnv(table, "random", shield=False), sdhj.Controller(table), 0
    for seed in range(4):
        observation, info = env.reset(seed=seed)
        while not info["outcome"]:
            known, now = observation[None, :-1], int(observation[-1])
            told = controller.filter(np.repeat(known, 5, axis=0), now, np.arange(5), first=True)  # carried by `env`
            assert told.promised.all() and np.array_equal(info["action_mask"] == 1, ~told.changed)
            action = int(np.flatnonzero(info["action_mask"])[-1])
            low, high, _ = table.bounds_of_next_points(known, np.array([action]), 0)
            observation, *_, info = env.step(np.int64(action))
            assert ((low <= observation[:-1] + 1e-12) & (observation[:-1] <= high + 1e-12)).all()
            differs += int(np.abs(observation[:-1] - env.runs.states[0]).max() > 0)
            assert (np.abs(observation[:-1] - env.runs.states[0]) <= test_memory.ERROR + 1e-12).all(), now
        assert info["outcome"] == "reached"
    assert differs > 100
