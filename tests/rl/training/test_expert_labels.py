"""Expert labels of earlier levels stay in the training data of later levels."""

import numpy as np
import pytest
import torch

from hydro.rl.training.expert_labels import ROWS, ExpertLabels, imitate
from hydro.rl.training.policy import median, network

OPEN, SLALOM, FOREST = ("point_to_point", 0), ("slalom", 4), ("forest", 12)
RNG = torch.Generator


def said(level, rows, seed=0):
    """Return observations whose first number is their level, and the expert actions there."""
    seen = np.random.default_rng(seed).uniform(-1.0, 1.0, (rows, 3)).astype(np.float32)
    seen[:, 0] = level
    return seen, np.column_stack([0.8 * np.sin(2.0 * seen[:, 1] + level), 0.5 * seen[:, 2]]).astype(
        np.float32
    )


def advice(*rows):
    made = ExpertLabels()
    for level, (name, count) in enumerate(zip((OPEN, SLALOM, FOREST), rows, strict=False)):
        made.add(name, *said(level, count))
    return made


def test_at_least_half_of_a_batch_is_of_the_newest_level_and_the_rest_of_those_before():
    """Older levels are drawn by their number of labels; a level with new labels becomes the newest."""
    made = advice(490, 1500, 400)
    for newest in (2, 0):
        if newest == 0:
            made.add(OPEN, *said(0, 10, seed=1))
        seen = torch.cat([each for each, _ in made.batches(60, RNG().manual_seed(1))])
        assert len(seen) == 60 * ROWS
        shares = [(seen[:, 0] == level).float().mean().item() for level in range(3)]
        expected = {2: [0.5 * 490 / 1990, 0.5 * 1500 / 1990, 0.5], 0: [0.5, 0.5 * 15 / 19, 0.5 * 4 / 19]}[
            newest
        ]
        assert shares == pytest.approx(expected, abs=0.02)
    assert made.levels == [SLALOM, FOREST, OPEN]


def test_a_batch_of_the_first_level_is_of_it_alone():
    (seen, done), *_ = advice(7).batches(1, RNG().manual_seed(0))
    assert seen.shape == (ROWS, 3)
    assert done.shape == (ROWS, 2)
    assert (seen[:, 0] == 0).all()


def test_who_learns_a_new_level_keeps_an_earlier_one():
    """Without labels of the earlier level, the policy forgets it."""
    seen, wanted = said(0, 500, seed=5)

    def error(net):
        return np.abs(median(net, seen) - wanted).mean()

    def learnt(made, net=None):
        torch.manual_seed(0)
        net = net or network(3, 2, (32, 32))
        imitate(net, made, 400, RNG().manual_seed(2))
        return net

    first = learnt(advice(300))
    before = error(first)
    kept = learnt(advice(300, 900), learnt(advice(300)))
    alone = advice(300, 900)
    alone.forget(OPEN)
    lost = learnt(alone, learnt(advice(300)))
    assert before < 0.05
    assert error(kept) < 0.08
    assert error(lost) > 3.0 * error(kept)


def test_what_was_said_comes_back():
    made, other = advice(40, 60), ExpertLabels()
    other.restore(made.state())
    assert other.levels == made.levels
    for (one, done), (two, same) in zip(
        made.batches(3, RNG().manual_seed(3)), other.batches(3, RNG().manual_seed(3)), strict=True
    ):
        assert torch.equal(one, two)
        assert torch.equal(done, same)
