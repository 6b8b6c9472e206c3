"""Train a policy with PPO.

The folder of a training contains `config.json` (settings, versions, command), `progress.csv`, events for TensorBoard,
`best.npz` (the policy with the best validation score), `final.npz` (the last policy), and `metrics.json`. `resume`
continues from `checkpoint.npz`, a file that exists from the first checkpoint to the end of the training.
"""

import json
from collections.abc import Mapping
from contextlib import closing
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn
from torch.utils.tensorboard.writer import SummaryWriter

from agents.baselines import PaperTrapezoid
from agents.policies import Policy, load_policy
from agents.policies.networks import Affine, Network
from agents.setups import Setup, Training, load_setup
from agents.setups.feasible import doubts
from agents.setups.keys import prefixed_errors
from agents.setups.training import SLOTS
from agents.train import checkpoint
from agents.train.callback import TrainingCallback
from agents.train.imitation import PPOWithImitation, Teacher
from agents.train.networks import ACTIVATIONS, AsymmetricPolicy, Standardised, standardisation
from impact_gym.parameters import Index, Options
from impact_gym.sb3 import ImpactVecEnv
from impact_gym.support.command_line import command_of, progress
from impact_gym.support.files import locked, write_file, writing
from impact_gym.support.provenance import machine_and_versions, revision
from impact_gym.task import ObservationSpec, Task

FIRST_SEED = 10_000_000
"""In the training with seed s, environment i has the seed FIRST_SEED + s * SLOTS + i. The shipped evaluation sets have
smaller seeds, and trainings with different seeds have no environment seed in common."""
PACKAGES = ("impact-gym", "gymnasium", "numpy", "scipy", "stable-baselines3", "torch")


@dataclass(frozen=True)
class Run(Options):
    """One training: a set-up, settings and a seed."""

    setup: Setup
    training: Training
    seed: Index = 0  # seed of the training scenarios, the initial network and the exploration

    @cached_property
    def task(self) -> Task:
        """The set-up's task, with the training's range of time weights."""
        return self.setup.task.changed({"time_weight": list(self.training.time_weight)})

    @cached_property
    def teacher(self) -> Teacher | None:
        """The baseline to imitate, if any."""
        training = self.training
        return Teacher(self.setup, training.teacher, training.informed_critic) if training.teacher else None

    @property
    def slots(self) -> list[dict[str, Any]]:
        """Changed arguments of each environment: first none, then those of `Setup.mixed`, then `Evaluation.nominal`."""
        shares = (*self.setup.mixed, (self.training.nominal, self.setup.evaluation.nominal))
        others = [dict(changes) for share, changes in shares for _ in range(round(share * self.training.envs))]
        return [{} for _ in range(self.training.envs - len(others))] + others

    @property
    def command(self) -> str:
        """The shortest command line that starts this training."""
        seed = ["--seed", str(self.seed)] if self.seed else []
        return command_of("train", self.training, self.setup.training, self.setup.cli_name, *seed)

    def made_for(self) -> dict[str, Any]:
        """Return the settings, the environment and other inputs that determine the result, as JSON values."""
        evaluation, training = self.setup.evaluation, self.training
        settings = {"setup": self.setup.cli_name, "seed": self.seed, **asdict(training)}
        made = {"settings": settings, "environment": self.task.arguments(), "weights": evaluation.weights}
        made |= {"teacher": self.teacher.checksum} if self.teacher else {}
        made |= {"nominal": evaluation.nominal} if training.nominal else {}
        made |= {"mixed": self.setup.mixed} if self.setup.mixed else {}
        return json.loads(json.dumps(made))

    @classmethod
    def of_record(cls, settings: Mapping[str, Any]) -> "Run":
        """Return the run with the settings of `made_for`; ValueError: this version cannot use these settings."""
        own = {name: value for name, value in settings.items() if name not in ("setup", "seed")}
        return cls(load_setup(settings["setup"]), Training().changed(own), settings["seed"])


class ScaledRewards(VecEnvWrapper):
    """Environments that divide rewards by (1 + time weight) ** power, see `Training.weight_power`."""

    def __init__(self, envs: ImpactVecEnv, power: float) -> None:
        super().__init__(envs)
        self._power, self._decode = power, envs.observation_spec.decode

    def reset(self) -> VecEnvObs:
        """Begin an episode in each environment."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """Play a step; the time weight of the episode scales the reward."""
        observations, rewards, ended, infos = self.venv.step_wait()
        last = np.array(observations)
        for row in np.flatnonzero(ended):
            last[row] = infos[row]["terminal_observation"]  # `observations` has the first one of the next episode
        scale = np.asarray((1.0 + self._decode(last, "time_weight")) ** -self._power, np.float32)
        return observations, rewards * scale, ended, infos


def make_environments(run: Run) -> ScaledRewards:
    """Return the environments of a training, see `Run.slots`; an informed critic also observes the true scenario."""
    training, slots = run.training, run.slots if any(run.slots) else None
    faster = {} if training.rtol is None else {"rtol": training.rtol}
    arguments = run.task.changed({**faster, "privileged": training.informed_critic}).arguments()
    arguments["horizon"] = run.task.horizon  # in all slots
    envs = ImpactVecEnv(training.envs, threads=training.simulation_threads, per_slot=slots, **arguments)
    return ScaledRewards(envs, training.weight_power)


def make_model(run: Run, environments: ScaledRewards) -> PPO:
    """Return an untrained model. The discount is 1, because the aim is the sum of the rewards of an episode."""
    training = run.training
    network = {
        "actor_inputs": len(ObservationSpec(run.task)),
        "net_arch": [training.width] * training.depth,
        "activation_fn": ACTIVATIONS[training.activation],
        "features_extractor_class": Standardised,
        "features_extractor_kwargs": {"tasks": environments.get_attr("batch", [0])[0].tasks},
        "log_std_init": training.log_std,
        "optimizer_kwargs": {"eps": 1e-5, "fused": True},
    }
    arguments: dict[str, Any] = {
        "policy": AsymmetricPolicy, "policy_kwargs": network, "env": environments, "n_steps": training.rollout,
        "batch_size": min(training.batch, training.round), "n_epochs": training.epochs, "learning_rate": training.rate,
        "gamma": 1.0, "gae_lambda": training.gae_lambda, "clip_range": training.clip, "ent_coef": training.entropy,
        "seed": run.seed, "device": "cpu",
    }  # fmt: skip
    if run.teacher is None:
        return PPO(**arguments)
    return PPOWithImitation(teacher=run.teacher, imitation_steps=training.imitation_steps, **arguments)


def policy_from(model: PPO, run: Run, provenance: Mapping[str, Any]) -> Policy:
    """Return a copy of a model's actor as a policy; the policy's first layer includes the standardisation."""
    actor = *model.policy.mlp_extractor.policy_net, model.policy.action_net
    linear = [layer for layer in actor if isinstance(layer, torch.nn.Linear)]
    arrays = [[parameter.detach().numpy().copy() for parameter in layer.parameters()] for layer in linear]
    centre, spread = standardisation([run.task])
    weight = arrays[0][0] / spread
    arrays[0] = [weight.astype(np.float32), (arrays[0][1] - weight @ centre).astype(np.float32)]
    hidden = [Affine(f"hidden_{place}", *layer) for place, layer in enumerate(arrays[:-1])]
    mean, log_std = Affine("mean", *arrays[-1]), model.policy.log_std.detach().numpy().copy()
    noise = Affine("log_std", np.zeros_like(mean.weight), log_std)
    return Policy(Network(tuple(hidden), mean, noise, run.training.activation), run.task, provenance)


def train(run: Run, out: Path | None = None) -> Path:
    """Train, write the run folder, and return its path."""
    with prefixed_errors(run.setup.cli_name):
        for sentence in doubts(run.task):
            print(f"warning: {sentence}")
    stamp = datetime.now(UTC).strftime("%Y%m%d-%H%M%S")
    folder = out or Path("runs") / f"{stamp}-{run.setup.name}-seed{run.seed}"
    record = {"command": run.command, **run.made_for(), **revision(), **machine_and_versions(*PACKAGES)}
    folder.mkdir(parents=True)
    write_file(folder / "config.json", json.dumps(record, indent=2) + "\n")
    return _finish(folder, run, record)


def resume(folder: Path) -> Path:
    """Begin the run in `folder`, or continue an unfinished run from its last checkpoint; return `folder`."""
    try:
        record = json.loads((folder / "config.json").read_text())
        run = Run.of_record(record["settings"])
        if any(record[name] != value for name, value in run.made_for().items()):
            raise ValueError(f"the set-up {run.setup.cli_name} has changed since the run began; train in a new folder")
    except (OSError, LookupError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(f"{folder} holds no run that this version can resume: {error}") from error
    return _finish(folder, run, record)


def _finish(folder: Path, run: Run, record: dict[str, Any]) -> Path:
    with writing(f"the run in {folder}"), locked(folder / "lock", wait=False):
        if not (folder / "metrics.json").is_file():
            _learn(folder, run, record)
    return folder


def _learn(folder: Path, run: Run, record: dict[str, Any]) -> None:
    training = run.training
    torch.set_num_threads(training.threads)
    torch.distributions.Distribution.set_default_validate_args(False)  # these checks are slow
    environments = make_environments(run)
    model = make_model(run, environments)
    environments.seed(FIRST_SEED + run.seed * SLOTS)
    policy = partial(policy_from, model, run, record)
    callback = TrainingCallback(folder, run.setup, training, policy)
    model.set_logger(Logger(None, []))
    saved = folder / "checkpoint.npz"
    if saved.is_file():
        callback.kept |= checkpoint.restore(saved, model, training)
        print(f"resuming at step {model.num_timesteps:,} of {training.whole_steps:,} steps")
    else:
        print(f"training for {training.whole_steps:,} steps; torch uses {training.threads} thread(s)")
    done = model.num_timesteps
    for events in [] if done else folder.glob("events.out.tfevents.*"):  # of a process killed before a checkpoint
        events.unlink()
    bar = progress(f"{run.setup.name}, seed {run.seed}", training.whole_steps, done)
    dropped = done + 1 if done else None  # from this step on, TensorBoard drops the values of the interrupted run
    with SummaryWriter(folder, purge_step=dropped) as callback.writer, closing(bar) as callback.bar:
        model.learn(
            training.whole_steps - done,
            callback=callback,
            log_interval=None,  # type: ignore[arg-type]  # None: the callback writes the log (stable-baselines3 2.9)
            reset_num_timesteps=not saved.is_file(),
        )
    rule = callback.validation.score(PaperTrapezoid().for_task(run.task))
    scores = {name: load_policy(folder / f"{name}.npz").provenance["validation"] for name in ("best", "final")}
    metrics = {
        "validation": {**scores, "paper's rule": rule},
        "curve": [{"steps": steps, "score": score} for steps, score in callback.kept["curve"]],
        "training_seconds": callback.kept["seconds"],
        "steps_per_second": training.whole_steps / callback.kept["seconds"],
    }
    write_file(folder / "metrics.json", json.dumps(metrics, indent=2) + "\n")
    saved.unlink(missing_ok=True)
    best, last = scores.values()
    for weight, *point in zip(*(best[key] for key in ("time_weight", "object_velocity", "approach_time")), strict=True):
        print("w = {:g} m/s per s: V_p {:.3f} m/s, touch after {:.3f} s".format(weight, *point))
    print(f"cost {best['score']:.3f} m/s (best.npz, mean over these w), lower is better; "
          f"paper's rule {rule['score']:.3f} m/s, last policy {last['score']:.3f} m/s")  # fmt: skip
