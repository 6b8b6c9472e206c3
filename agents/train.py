"""Train a policy: `python -m agents.train`. Writes a run folder and prints its path."""

import json
import platform
import shlex
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import VecMonitor

from agents.baselines import PaperTrapezoid
from agents.evaluation import VALIDATION_SEED, Controller, evaluate
from agents.policy import Policy
from impact_gym.files import whole_file
from impact_gym.sb3 import ImpactVecEnv
from impact_gym.validation import number, whole

PACKAGES = ("impact-gym", "gymnasium", "numba", "numpy", "scipy", "stable-baselines3", "torch")


@dataclass(frozen=True)
class Settings:
    """Train PPO on ImpactApproach-v0."""

    steps: int = 6_000_000
    """Environment steps in all; rounded up to whole rollouts of all environments."""
    seed: int = 0
    """Seed of the scenarios, the network and the exploration; below 1000000, where evaluation begins."""
    out: Path | None = None
    """Run folder; it must not exist. Default: a new one below runs/."""
    time_weight: float = 2.0
    """What a second of approach costs, in m/s of object velocity."""
    envs: int = 512
    """Environments side by side."""
    rollout: int = 64
    """Steps of each environment between two updates; an episode has about 30."""
    batch: int = 2048
    """Samples of a gradient step."""
    epochs: int = 4
    """Passes over a rollout."""
    learning_rate: float = 1e-3
    """At the start; falls linearly to a tenth."""
    gae_lambda: float = 0.95
    """Trade of bias for variance in the advantage. The discount is 1: an episode ends, and what counts is its sum."""
    entropy: float = 0.0
    """Bonus on exploration."""
    log_std: float = -1.0
    """Initial exploration, logarithm of a standard deviation; much more makes never touching attractive."""
    width: int = 64
    """Neurons in each of the two hidden layers."""
    threads: int = 1
    """Threads of torch. With small networks a second one on two cores makes it slower, not faster."""

    def __post_init__(self) -> None:
        for name in ("steps", "envs", "epochs", "width", "threads"):
            whole(name, getattr(self, name), at_least=1)
        for name in ("rollout", "batch"):
            whole(name, getattr(self, name), at_least=2)
        whole("seed", self.seed, at_least=0)
        if self.seed >= VALIDATION_SEED - self.envs:
            raise ValueError(f"seed must be below {VALIDATION_SEED - self.envs}, got {self.seed}")
        number("time_weight", self.time_weight, "m/s per s", above=0)
        number("learning_rate", self.learning_rate, "(no unit)", above=0)
        number("gae_lambda", self.gae_lambda, "(no unit)", at_least=0, at_most=1)
        number("entropy", self.entropy, "(no unit)", at_least=0)
        number("log_std", self.log_std, "(no unit)", at_least=-20, at_most=2)

    @property
    def whole_steps(self) -> int:
        """Environment steps that are really made."""
        return -(-self.steps // (self.envs * self.rollout)) * self.envs * self.rollout


class Objectives(BaseCallback):
    """Logs the two objectives by name, as means over the episodes that ended since the last update."""

    def __init__(self) -> None:
        super().__init__()
        self._ended: list[dict[str, Any]] = []

    def _on_step(self) -> bool:
        self._ended += [info for info, done in zip(self.locals["infos"], self.locals["dones"], strict=True) if done]
        return True

    def _on_rollout_end(self) -> None:
        if not self._ended:
            return
        for name in ("object_velocity", "approach_time", "peak_force", "missed"):
            self.logger.record(f"objectives/{name}", float(np.mean([info[name] for info in self._ended])))
        self._ended.clear()


def export(model: PPO, provenance: dict[str, Any]) -> Policy:
    """Return the deterministic part of a trained model, and its noise, as plain arrays."""
    network = model.policy
    layers = [layer for layer in network.mlp_extractor.policy_net if isinstance(layer, torch.nn.Linear)]
    layers.append(network.action_net)
    return Policy(
        [layer.weight.detach().numpy().copy() for layer in layers],
        [layer.bias.detach().numpy().copy() for layer in layers],
        network.log_std.detach().numpy().copy(),
        provenance,
    )


def judge(controller: Controller, time_weight: float) -> dict[str, float]:
    """Return both objectives over 1,000 validation scenarios, which are not the test scenarios of the report."""
    episodes = evaluate(controller, VALIDATION_SEED, 1000, scenario="train", time_weight=time_weight)
    return {
        "object_velocity": float(episodes.object_velocity.mean()),
        "approach_time": float(episodes.approach_time.mean()),
        "missed": float(episodes.missed.mean()),
    }


def write_json(path: Path, content: Any) -> None:
    """Write `content` to `path`, whole or not at all."""
    with whole_file(path) as file:
        file.write((json.dumps(content, indent=2, default=str) + "\n").encode())


def provenance(settings: Settings) -> dict[str, Any]:
    """Return what it takes to repeat a run."""
    return {
        "command": shlex.join(["python", "-m", "agents.train", *sys.argv[1:]]),
        "settings": {name: value for name, value in asdict(settings).items() if name != "out"},
        "versions": {"python": platform.python_version()} | {name: version(name) for name in PACKAGES},
        "commit": _git("rev-parse", "HEAD"),
        "changed since": _git("status", "--porcelain", "--untracked-files=no"),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _git(*command: str) -> str | None:
    """Return what git says of the sources, None where there is no git or no repository."""
    try:
        said = subprocess.run(["git", *command], cwd=Path(__file__).parent, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return said.stdout.strip()


def train(settings: Settings) -> Path:
    """Train, write the run folder, and return its path.

    Raises:
        FileExistsError: the run folder is there already.
    """
    stamp = datetime.now(UTC).strftime("%Y%m%d-%H%M%S")
    folder = settings.out or Path("runs") / f"{stamp}-ppo-seed{settings.seed}"
    folder.mkdir(parents=True)
    record = provenance(settings)
    write_json(folder / "config.json", record)

    torch.set_num_threads(settings.threads)
    envs = VecMonitor(ImpactVecEnv(settings.envs, scenario="train", time_weight=settings.time_weight))
    model = PPO(
        "MlpPolicy",
        envs,
        seed=settings.seed,
        device="cpu",
        n_steps=settings.rollout,
        batch_size=settings.batch,
        n_epochs=settings.epochs,
        learning_rate=lambda remaining: settings.learning_rate * (0.1 + 0.9 * remaining),
        gamma=1.0,
        gae_lambda=settings.gae_lambda,
        ent_coef=settings.entropy,
        policy_kwargs={"net_arch": [settings.width, settings.width], "log_std_init": settings.log_std},
    )
    model.set_logger(configure(str(folder), ["tensorboard", "csv"]))
    print(f"training for {settings.whole_steps:,} steps; torch uses {settings.threads} thread(s)")
    begun = time.perf_counter()
    model.learn(settings.whole_steps, callback=Objectives(), progress_bar=True)
    seconds = time.perf_counter() - begun
    model.logger.close()

    policy = export(model, record)
    policy.save(folder / "policy.npz")
    metrics = {
        "validation": {
            "policy": judge(policy, settings.time_weight),
            "paper's rule": judge(PaperTrapezoid(), settings.time_weight),
        },
        "training_seconds": seconds,
        "steps_per_second": model.num_timesteps / seconds,
    }
    write_json(folder / "metrics.json", metrics)
    for name, means in metrics["validation"].items():
        print(f"{name}: V_p {means['object_velocity']:.4f} m/s, approach {means['approach_time']:.4f} s")
    return folder


def main() -> None:
    """Read the settings from the command line and train."""
    try:
        print(train(tyro.cli(Settings)))
    except (FileExistsError, TypeError, ValueError) as error:
        sys.exit(f"agents.train: {error}")
    except KeyboardInterrupt:
        print(
            "agents.train: interrupted; the run folder holds the learning curve so far, but no policy", file=sys.stderr
        )
        sys.exit(130)


if __name__ == "__main__":
    main()
