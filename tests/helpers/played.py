"""What was played of a matchup, as far as the answer needs it."""

from agents.evaluate import play as evaluations
from experiments.report.played import Played, Run


def played_alone(matchup):
    """Return what `answer` needs of a matchup, nothing else."""
    played = Played(matchup)
    for contestant in (*matchup.seeds, *matchup.baselines):
        of = contestant.controller, matchup.scenarios, contestant.weights, matchup.environment
        runs = played.seeds if contestant in matchup.seeds else played.baselines
        runs[contestant.name] = Run(contestant.weights, evaluations.play(*of))
    played.as_late = played.seeds
    return played
