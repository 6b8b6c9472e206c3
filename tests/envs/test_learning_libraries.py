"""stable-baselines3 and rl_zoo3 as they are used: learning, statistics kept, the command line."""

import csv
import importlib.util
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch
from episodes import ID, SLOTS, assert_identical
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

from impact_gym.sb3 import ImpactVecEnv

OPTIONS = {"scenario": "hard", "time_weight": (0.5, 8.0), "reaction_delay": 0.03}
ROOT = Path(__file__).parents[2]
CONFIGURATION = ROOT / "docs" / "examples" / "rl_zoo3.yml"


@pytest.fixture
def one_thread():
    """Torch is left as it was."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.mark.usefixtures("one_thread")
def test_ppo_learns_and_is_the_same_after_saving_with_its_statistics(tmp_path):
    envs = VecNormalize(VecMonitor(ImpactVecEnv(SLOTS, **OPTIONS), info_keywords=("reward_terms",)), gamma=1.0)
    model = PPO("MlpPolicy", envs, n_steps=64, batch_size=64, n_epochs=2, gamma=1.0, seed=0, device="cpu")
    start = [parameter.detach().clone() for parameter in model.policy.parameters()]
    model.learn(768)
    assert model.num_timesteps == 768
    assert any(not torch.equal(before, after) for before, after in zip(start, model.policy.parameters(), strict=True))
    assert len(model.ep_info_buffer) > SLOTS
    for episode in model.ep_info_buffer:  # before normalisation, as in the final info
        assert episode["r"] == pytest.approx(sum(episode["reward_terms"].values()), rel=1e-6)
        assert 20 <= episode["l"] <= 80

    model.save(tmp_path / "model")
    envs.save(str(tmp_path / "statistics"))
    bare = VecMonitor(ImpactVecEnv(SLOTS, **OPTIONS))
    again = VecNormalize.load(str(tmp_path / "statistics"), bare)
    again.training = envs.training = False
    loaded = PPO.load(tmp_path / "model", device="cpu")
    envs.seed(9), again.seed(9)
    observations = envs.reset()
    assert_identical(again.reset(), observations)
    for _ in range(60):
        action, _ = model.predict(observations, deterministic=True)
        assert_identical(loaded.predict(observations, deterministic=True)[0], action)
        observations, *rest = envs.step(action)
        repeated, *rest_repeated = again.step(action)
        assert_identical([repeated, *rest_repeated[:2]], [observations, *rest[:2]])
    mean, deviation = again.obs_rms.mean, np.sqrt(again.obs_rms.var + again.epsilon)
    raw = again.get_original_obs()
    assert observations == pytest.approx(np.clip((raw - mean) / deviation, -10, 10), abs=1e-5)
    assert np.all(np.abs(raw) <= 1.0)


@pytest.fixture
def gymnasiums_own_time_limit(monkeypatch):
    """rl_zoo3, which its models import where they are loaded, replaces TimeLimit; here until the test ends."""
    own = gym.wrappers.TimeLimit
    for module in (gym.wrappers, gym.wrappers.common, gym.envs.registration):
        monkeypatch.setattr(module, "TimeLimit", own, raising=False)


@pytest.mark.usefixtures("gymnasiums_own_time_limit")
@pytest.mark.skipif(importlib.util.find_spec("rl_zoo3") is None, reason="rl_zoo3 is not installed; see docs/examples")
def test_rl_zoo3_trains_from_its_command_line(tmp_path):
    # not imported here: it replaces Gymnasium's TimeLimit by its own
    arguments = (
        f"-m rl_zoo3.train --algo ppo --env {ID} --gym-packages impact_gym -n 512 --seed 3 --eval-freq -1 "
        f"--num-threads 1 --device cpu -conf {CONFIGURATION.relative_to(ROOT)} -f {tmp_path}"
    )
    subprocess.run([sys.executable, *arguments.split()], cwd=ROOT, check=True, capture_output=True)
    folder = tmp_path / "ppo" / f"{ID}_1"
    model = PPO.load(folder / f"{ID}.zip", device="cpu")
    env = gym.make(ID)
    assert (model.observation_space, model.action_space) == (env.observation_space, env.action_space)
    assert (model.n_envs, model.num_timesteps) == (64, 4096)  # one whole rollout: 64 steps of each
    layers = [layer for layer in model.policy.mlp_extractor.policy_net if hasattr(layer, "weight")]
    assert [layer.out_features for layer in layers] == [64, 64]
    episodes = []
    for file in folder.glob("*.monitor.csv"):
        with file.open() as lines:
            episodes += list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert len(episodes) >= 64
    for episode in episodes:
        assert 20 <= int(episode["l"]) <= 80
        assert -6.0 < float(episode["r"]) < 0.0
