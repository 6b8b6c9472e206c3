"""What was played of a matchup, as far as the answer needs it."""

from agents.evaluate import play as evaluations
from experiments.report.played import Played, Run


def played_alone(matchup):
    """Return what `answer` needs of a matchup, nothing else."""
    played = Played(matchup)
    for one in (*matchup.seeds, *matchup.baselines):
        arrays = evaluations.play(one.controller, matchup.scenarios, list(one.weights), matchup.environment)
        runs = played.seeds if one in matchup.seeds else played.baselines
        runs[one.name] = Run(one.weights, arrays)
    played.as_late = played.seeds
    return played
