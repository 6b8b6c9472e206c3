"""What a scene needs: advise(scene, motion, tolerance) names the parts that do not matter for V_p and leaves them out.

    encounter, isolated, aftermath    closed forms: how the tool arrives, the contact alone, whether they meet again
    situation, swing                  their sum for one scene, in dimensionless numbers
    groups, prediction                the error of each reduction: groups times calibrated constants (constants.json)
    advice                            which reductions a tolerance allows

Nothing here runs the scene that is asked about. `python -m experiments.fidelity` makes the constants.
"""

from impact_gym.fidelity.advice import Advice, Reduction, advise

__all__ = ["Advice", "Reduction", "advise"]
