"""Who copes with a range sensor that nobody knows: PPO on different inputs, and filters that know more or less."""

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import polars as pl
from numpy.typing import NDArray

from agents.baselines import tuned_rule
from agents.baselines.cmaes import minimise
from agents.baselines.filtered import END, SelfCalibratingProfile
from agents.baselines.rule import Floats, Parameter, View, ranges_for
from agents.evaluate.scenario_batch import TUNING_SEED, ScenarioBatch
from agents.evaluate.specs import scenario_batch_of
from agents.policies import Controller
from agents.setups import Training, load_setup
from agents.setups.training import SLOTS
from agents.setups.tuned import read_tuned
from experiments.lab import grid
from experiments.studies.sensors.ahead import LookAhead
from impact_gym.task import ObservationSpec, Task

SETUP = load_setup("sensed-robust")
READINGS = 8  # in the input "readings", one for each control step
USUAL = np.array([0.1, 0.007, 0.07])  # m, m, -: usual size of the filter's distance, bias and scale
INPUTS = {  # what the actor observes in addition to the environment's observation
    "reading": "nothing",
    "readings": f"the last {READINGS} readings, and how far the flange moved since each",
    "recurrent": "nothing, but it has a memory (LSTM)",
    "filter": "the filter's distance, bias and scale, and their standard deviations",
    "profile": "as with filter, and the profile's action, to which its own action is added",
}
TRAINING = Training(time_weight=(0.7, 4.0), simulation_threads=1)
POPULATION, NEAR = 16, 0.25  # of the search for a rival; it stays within this share of the range of each parameter


class ToldProfile(SelfCalibratingProfile):
    """`SelfCalibratingProfile` that is told bias and scale."""

    NEEDS: ClassVar[Mapping[str, Any]] = {**SelfCalibratingProfile.NEEDS, "privileged": True}

    def see(self, view: View, state: Any, episode_start: Any) -> tuple[View, Any]:
        """Return what `SelfCalibratingProfile.see` returns for the reading without bias and scale."""
        raw, most = view["range"], self.spec.scale("range").high
        true = (raw - view["range_sensor.bias"]) / (1.0 + view["range_sensor.scale"])
        told = np.where((raw > 0.0) & (raw < most), np.clip(true, 1e-6, 0.999 * most), raw)  # of others, none is used
        return super().see(View(view.observation, view.spec, range=told), state, episode_start)

    def ends(self, name: str) -> tuple[float, float]:
        """Return the range of what is left of a number of the sensor."""
        return 0.0, 0.0


class FirstProfile(SelfCalibratingProfile):
    """`SelfCalibratingProfile` that uses only the first valid reading."""

    READINGS = 1


RIVALS = {"first reading only": FirstProfile, "told bias and scale": ToldProfile, "looking ahead": LookAhead}


class Inputs:
    """The numbers that a network observes, one of INPUTS."""

    def __init__(self, name: str) -> None:
        self.name, self.spec = name, ObservationSpec(SETUP.task)
        self.rule = tuned_rule(read_tuned("sensed-robust-profile")).for_task(SETUP.task)

    def see(self, observations: Any, state: Any, start: NDArray[np.bool_]) -> tuple[Floats, Floats, Any]:
        """Return additional numbers (n, k) for `observations` (n, n_obs), actions (n, 2) to add, and the next state."""
        view = View(observations[:, : len(self.spec)], self.spec)
        added: NDArray[Any] = np.zeros((len(observations), 2))
        if self.name in ("reading", "recurrent"):
            return added[:, :0], added, None
        if self.name == "readings":
            now = np.stack([view["range"], view["position"]])
            first = np.broadcast_to(now, (READINGS, *now.shape))
            state = first if state is None else np.where(start, first, np.concatenate([now[None], state[:-1]]))
            return np.concatenate([state[:, 0], state[0, 1] - state[1:, 1]]).T / USUAL[0], added, state
        seen, state = self.rule.see(view, state, start)
        means = np.stack([seen["distance_estimate"], *state[END + 1 : END + 3]])
        spreads = np.sqrt(np.maximum(state[END + 3 :: 4], 1e-12))
        numbers = np.concatenate([means.T / USUAL, np.log(spreads.T / USUAL).clip(-3.0)], axis=1)
        if self.name == "profile":
            added = SETUP.task.action.encode(*self.rule.at(view["time_weight"]).command(seen))
            numbers = np.concatenate([numbers, added], axis=1)
        return numbers, added, state


def trained(name: str, seed: int, steps: int) -> Controller:
    """Return a network, trained with one of INPUTS, as a controller."""
    import torch
    from gymnasium import spaces
    from sb3_contrib import RecurrentPPO
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecEnvWrapper

    from agents.train.networks import ACTIVATIONS, AsymmetricPolicy, standardisation
    from agents.train.ppo import FIRST_SEED, Run, make_environments

    inputs, run = Inputs(name), Run(SETUP, TRAINING, seed)
    centre, spread = standardisation([run.task.changed({"privileged": True})])

    def numbers(observations: NDArray[Any], more: Floats) -> NDArray[np.float32]:
        count, own = observations.shape[1], len(inputs.spec)
        known = (observations - centre[:count]) / spread[:count]
        return np.concatenate([known[:, :own], more, known[:, own:]], axis=1, dtype=np.float32)

    class Seeing(VecEnvWrapper):
        def reset(self) -> Any:
            self.state = None
            return self.seen(self.venv.reset(), np.ones(self.num_envs, np.bool_))

        def step_async(self, actions: NDArray[Any]) -> None:
            self.venv.step_async(np.clip(self.added + actions, -1.0, 1.0))

        def step_wait(self) -> Any:
            observations, rewards, ended, infos = self.venv.step_wait()  # without a limit of steps, none is truncated
            return self.seen(observations, ended), rewards, ended, infos

        def seen(self, observations: Any, start: NDArray[np.bool_]) -> NDArray[np.float32]:
            more, self.added, self.state = inputs.see(observations, self.state, start)
            return numbers(observations, more)

    def predict(observation: Any, state: Any, episode_start: NDArray[np.bool_], deterministic: bool) -> tuple[Any, Any]:
        more, added, state = inputs.see(observation, state, episode_start)
        with torch.no_grad():
            own = model.policy.mlp_extractor.policy_net(torch.from_numpy(numbers(observation, more)))
            return np.clip(added + model.policy.action_net(own).numpy().clip(-1.0, 1.0), -1.0, 1.0), state

    def recall(observation: Any, state: Any, episode_start: Any, deterministic: bool) -> tuple[Any, Any]:
        seen = numbers(observation, np.zeros((len(observation), 0)))
        return model.predict(np.pad(seen, ((0, 0), (0, len(known) - actor))), state, episode_start, deterministic)

    torch.set_num_threads(1)
    environments, remembers = make_environments(run), name == "recurrent"
    more = inputs.see(environments.reset(), None, np.ones(TRAINING.envs, np.bool_))[0].shape[1]
    actor, known, layers = len(inputs.spec) + more, torch.ones(len(centre) + more), [TRAINING.width] * TRAINING.depth
    known[actor:] = 0.0
    memory = {"lstm_hidden_size": TRAINING.width, "enable_critic_lstm": False, "share_features_extractor": False}
    recurrent = {"net_arch": {"pi": layers[1:], "vf": layers}, **memory}
    network = {
        "activation_fn": ACTIVATIONS[TRAINING.activation], "optimizer_kwargs": {"eps": 1e-5, "fused": True},
        "log_std_init": -2.0 if name == "profile" else TRAINING.log_std,
        **(recurrent if remembers else {"net_arch": layers, "actor_inputs": actor}),
    }  # fmt: skip
    algorithm: Any = RecurrentPPO if remembers else PPO
    model = algorithm(
        "MlpLstmPolicy" if remembers else AsymmetricPolicy,
        Seeing(environments, spaces.Box(-np.inf, np.inf, (len(known),), np.float32)), policy_kwargs=network,
        n_steps=TRAINING.rollout, batch_size=TRAINING.batch, n_epochs=TRAINING.epochs,
        learning_rate=TRAINING.rate, gamma=1.0, gae_lambda=TRAINING.gae_lambda, seed=seed, device="cpu",
    )  # fmt: skip
    if remembers:  # hide from the actor what only the critic observes
        model.policy.pi_features_extractor.register_forward_hook(lambda _, __, seen: seen * known)
    environments.seed(FIRST_SEED + seed * SLOTS)
    model.learn(steps)
    return SimpleNamespace(predict=recall if remembers else predict)


def learn(inputs: str, seed: int, steps: int, scenarios: Mapping[str, Any], weights: Sequence[float]) -> pl.DataFrame:
    """Train a network with PPO, and return the rows of `judged`."""
    controller = trained(inputs, seed, steps)
    return pl.concat([judged(controller, SETUP.task, scenarios, weight) for weight in weights])


def rival(rival: str, weight: float, tuning: int, generations: int, scenarios: Mapping[str, Any]) -> pl.DataFrame:
    """Tune one of RIVALS in `tuning` scenarios, from the shipped parameters on; return the rows of `judged`."""
    kind, shipped = RIVALS[rival], tuned_rule(read_tuned("sensed-robust-profile")).at(weight).parameters
    task = SETUP.task.changed({"privileged": "privileged" in kind.NEEDS})
    options: Any = {"time_weight": [weight] * POPULATION, "copies": POPULATION, "threads": 1, "lenient": True}
    ranges, batch = ranges_for(task), ScenarioBatch(TUNING_SEED, tuning, task.changed({"rtol": 1e-5}), **options)

    def losses(candidates: Floats) -> Floats:
        rules = kind.of(np.repeat(candidates[:, 0], tuning, axis=0), ranges).for_task(task)
        return batch.play(rules).loss(weight).reshape(POPULATION, tuning).mean(axis=1)[:, None]

    def near(limits: Parameter, start: float) -> Parameter:
        least, most = start + NEAR * (limits.high - limits.low) * np.array([-1.0, 1.0])
        return limits._replace(low=max(limits.low, least), high=min(limits.high, most), start=start)

    search = tuple(map(near, kind.limited(ranges), shipped.tolist()))
    best = minimise(losses, search, 1, POPULATION, generations, seed=1).parameters[0] if generations else shipped
    return judged(kind.of(best, ranges).for_task(task), task, scenarios, weight)


def judged(controller: Controller, task: Task, scenarios: Mapping[str, Any], weight: float) -> pl.DataFrame:
    """Return the cost (m/s) at a time weight (m/s per s), and whether the object is missed, for each scenario."""
    played = scenario_batch_of(scenarios, weight, task).play(controller)
    return grid.rows_of(played, weight).select("weight", "episode", "missed", "cost")
