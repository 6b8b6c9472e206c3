"""Studies of this project. `impact-gym study NAME` runs `STUDY` of the module `experiments.studies.NAME`."""

from pkgutil import resolve_name

from experiments.lab.study import Study
from impact_gym.support.validation import nearest

QUESTIONS = {
    "paper": "Does the model agree with the paper?",
    "speed": "How fast are the solver, the environments and the training?",
    "stability": "Is the solver stable on random scenes?",
    "teleop": "Which assistance helps if the operator's commands arrive late?",
    "sensors": "What does a range sensor that is sold bring?",
    "stock": "How good is a policy after some minutes of training with stable-baselines3?",
    "engines": "Which blow do physics engines deliver if they are asked for a restitution?",
    "own-arms": "Does what impact-gym controller says hold for arms that nobody chose?",
}
"""The question of each study, by the study's name."""


def load(name: str) -> Study:
    """Return the study `name`, a key of QUESTIONS; ValueError: there is none."""
    if name not in QUESTIONS:
        raise ValueError(nearest("study", name, QUESTIONS))
    return resolve_name(f"experiments.studies.{name.replace('-', '_')}:STUDY")
