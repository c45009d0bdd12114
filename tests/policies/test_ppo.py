import csv
from dataclasses import replace

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

from deux.contracts import Action
from deux.errors import DeuxError
from deux.policies import ppo
from deux.policies.ppo import train_policy
from deux.policies.ppo_settings import PPOSettings
from deux.policies.training_state import load_training_state

TINY = PPOSettings(
    steps=512, episode=32, environments=2, rollout=64, batch_size=64, epochs=2, learning_rate=3e-3, checkpoint=2
)


@pytest.fixture
def made(monkeypatch):
    """The learners and the normalised environments that a training makes, in order."""
    made = {"learners": [], "environments": []}

    def learner(*arguments, **options):
        made["learners"].append(PPO(*arguments, **options))
        return made["learners"][-1]

    def environments(*arguments, **options):
        made["environments"].append(VecNormalize(*arguments, **options))
        return made["environments"][-1]

    monkeypatch.setattr(ppo, "PPO", learner)
    monkeypatch.setattr(ppo, "VecNormalize", environments)
    return made


def losses(folder, start=0):
    """The losses of each update."""
    (path,) = folder.glob(f"logs/from_{start}/progress.csv")
    names = ("train/loss", "train/value_loss", "train/policy_gradient_loss", "train/entropy_loss")
    with path.open() as file:
        return [[row[name] for name in names] for row in csv.DictReader(file) if row["train/loss"]]


def test_it_learns_what_is_rewarded(make_environment, likes_left, tmp_path):
    """One reward that everybody can check: a turn to the left is worth 1, all else nothing."""
    settings = replace(TINY, steps=1536, learning_rate=5e-3, entropy=0.0)
    result = train_policy(settings, make_environment(likes_left), 0, tmp_path)
    environment = make_environment()()
    view, _ = environment.reset(seed=5)
    shown = {name: torch.from_numpy(part)[None] / (255.0 if name != "body" else 1.0) for name, part in view.items()}
    chances = result.network(shown).softmax(dim=1)[0]
    assert chances[Action.LEFT] > 0.8
    curve = result.curve
    assert curve.steps == sorted(curve.steps)
    assert curve.steps[-1] == 1536
    assert len(curve.steps) == len(curve.reward) == len(curve.area)
    assert curve.reward[0] < 20.0, "of 32 moves a third, in the beginning"
    assert curve.reward[-1] > 1.5 * curve.reward[0], "the curve shows the rewards as the reward gives them"
    assert 0.0 < curve.area[-1] < 30.0
    assert result.reward_state["given"] > 100.0


def test_the_policy_that_is_returned_is_the_one_that_was_trained(make_environment, tmp_path, made):
    """The same chances as stable-baselines3's own policy gives to the same observation, bytes and all."""
    result = train_policy(replace(TINY, steps=256), make_environment(), 0, tmp_path)
    (learner,) = made["learners"]
    environment = make_environment()()
    environment.reset(seed=1)
    for _ in range(8):
        view, *_ = environment.step(np.int64(0))
        batch, _ = learner.policy.obs_to_tensor(view)
        expected = learner.policy.get_distribution(batch).distribution.probs
        shown = {name: torch.from_numpy(part)[None] for name, part in view.items()}
        shown = {name: part / 255.0 if part.dtype == torch.uint8 else part for name, part in shown.items()}
        torch.testing.assert_close(result.network(shown).softmax(dim=1), expected)
    assert not result.network.training


def test_the_same_seed_gives_the_same_losses(make_environment, tmp_path):
    results = []
    for run, seed, steps in (("a", 1, 384), ("b", 1, 384), ("c", 2, 256)):
        train_policy(replace(TINY, steps=steps), make_environment("curiosity"), seed, tmp_path / run)
        results.append(losses(tmp_path / run))
    assert len(results[0]) >= 2
    assert results[0] == results[1]
    assert results[0][0] != results[2][0]


def test_training_goes_on_from_its_checkpoint_to_the_full_number_of_steps(make_environment, likes_left, tmp_path):
    """Killed between two checkpoints, then started again, then asked for more."""
    seen = []

    def kill(stage, done, total):
        seen.append(done)
        if done == 384:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_policy(TINY, make_environment(likes_left), 0, tmp_path, kill)
    saved = load_training_state(tmp_path / "checkpoint.pt")
    assert saved.steps == 256, "after two of the updates of 128 steps"
    seen.clear()
    result = train_policy(TINY, make_environment(likes_left), 0, tmp_path, lambda stage, done, total: seen.append(done))
    assert seen == [384, 512]
    done = load_training_state(tmp_path / "checkpoint.pt")
    assert done.steps == 512
    kept = len(saved.curve[0])
    assert kept > 0
    for before, after, returned in zip(
        saved.curve, done.curve, (result.curve.steps, result.curve.reward, result.curve.area), strict=True
    ):
        assert after[:kept] == before
        assert after == returned
    assert done.returns[2] > saved.returns[2], "the normaliser goes on counting"
    assert all(after["given"] >= before["given"] for before, after in zip(saved.rewards, done.rewards, strict=True))
    assert losses(tmp_path), "the log of the first part is still there"
    assert (tmp_path / "logs" / "from_256" / "progress.csv").is_file()


def test_what_is_resumed_equals_what_was_saved(make_environment, likes_left, tmp_path, made):
    """A training that is complete is loaded and not trained further: weights, Adam, normaliser, rewards."""
    first = train_policy(TINY, make_environment(likes_left), 0, tmp_path)
    second = train_policy(TINY, make_environment(likes_left), 0, tmp_path)
    before, after = made["learners"]
    assert after.num_timesteps == before.num_timesteps == 512
    torch.testing.assert_close(after.policy.state_dict(), before.policy.state_dict(), rtol=0.0, atol=0.0)
    ours, theirs = before.policy.optimizer.state_dict(), after.policy.optimizer.state_dict()
    torch.testing.assert_close(theirs["state"], ours["state"], rtol=0.0, atol=0.0)
    saved, loaded = (environments.ret_rms for environments in made["environments"])
    assert (float(loaded.mean), float(loaded.var), loaded.count) == (float(saved.mean), float(saved.var), saved.count)
    assert saved.var != 1.0
    assert first.curve == second.curve
    np.testing.assert_array_equal(first.reward_state["given"], second.reward_state["given"])
    for ours, theirs in zip(first.network.parameters(), second.network.parameters(), strict=True):
        assert torch.equal(ours, theirs)


def test_a_resumed_training_sees_other_episodes_than_at_its_beginning(make_environment, tmp_path, made):
    train_policy(replace(TINY, steps=256), make_environment(), 0, tmp_path)
    train_policy(replace(TINY, steps=384), make_environment(), 0, tmp_path)
    starts = [learner.rollout_buffer.observations["near"][0] for learner in made["learners"]]
    assert not np.array_equal(*starts)


def test_the_learning_rate_falls_on_from_where_it_was(make_environment, tmp_path, made):
    train_policy(replace(TINY, steps=256), make_environment(), 0, tmp_path)
    train_policy(TINY, make_environment(), 0, tmp_path)
    rate = made["learners"][1].policy.optimizer.param_groups[0]["lr"]
    # The last update, at the end of 512 steps, has none left; the one before it had a quarter.
    assert rate == pytest.approx(0.0)
    assert made["learners"][1]._total_timesteps == 512


def test_the_first_episodes_end_one_after_the_other(make_environment, tmp_path):
    """Otherwise every rollout would show one phase of an episode only."""
    environments = []

    def make():
        environments.append(make_environment()())
        return environments[-1]

    settings = replace(TINY, environments=4, rollout=16, steps=64)
    train_policy(settings, make, 0, tmp_path)
    # After 16 steps of episodes of 8, 16, 24 and 32 steps.
    assert [environment._length for environment in environments] == [32, 32, 24, 32]
    assert [environment._step for environment in environments] == [8, 0, 16, 16]


def test_a_checkpoint_of_another_training_is_reported_in_one_sentence(make_environment, likes_left, tmp_path):
    train_policy(replace(TINY, steps=128), make_environment(likes_left), 0, tmp_path)
    path = tmp_path / "checkpoint.pt"
    more = replace(TINY, environments=3)
    with pytest.raises(DeuxError, match=f"^{path} is of another training .*: delete it to train from zero") as caught:
        train_policy(more, make_environment(likes_left), 0, tmp_path)
    assert "\n" not in str(caught.value)
    state = load_training_state(path)
    state.policy["action_net.bias"] = torch.zeros(5)
    ppo.save_training_state(path, state)
    with pytest.raises(DeuxError, match=f"^{path} is of another training .*: delete it to train from zero") as caught:
        train_policy(TINY, make_environment(likes_left), 0, tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("option", ["steps", "episode", "environments", "rollout", "epochs", "checkpoint"])
def test_settings_below_one_are_refused(option):
    with pytest.raises(DeuxError, match=rf"explorer_training\.{option} is 0"):
        PPOSettings(**{option: 0})


def test_a_batch_is_no_larger_than_a_rollout():
    with pytest.raises(DeuxError, match=r"explorer_training\.batch_size is 300"):
        PPOSettings(environments=2, rollout=128, batch_size=300)


def test_no_update_goes_uphill_where_the_last_rollout_goes_beyond_the_steps(make_environment, tmp_path, monkeypatch):
    rates = []
    train = PPO.train

    def recorded(learner):
        train(learner)
        rates.append(learner.policy.optimizer.param_groups[0]["lr"])

    monkeypatch.setattr(PPO, "train", recorded)
    train_policy(replace(TINY, steps=300), make_environment(), 0, tmp_path)
    # Rollouts of 2 x 64 steps: 172 and 44 of the 300 steps are left after the first and the second.
    assert rates == pytest.approx([3e-3 * 172 / 300, 3e-3 * 44 / 300, 0.0])
