"""Datasets of Minari, which wants infos of one structure at every step; needs the extra `minari`."""

from typing import Any

from minari import StepDataCallback


class EpisodeInfo(StepDataCallback):  # type: ignore[misc]  # Minari ships no types
    """As info of every step, what the final info has, as it stands then; Minari cannot record the empty ones before it.

    Give it to `minari.DataCollector` as `step_data_callback`, with `record_infos=True`.
    """

    def __call__(self, env: Any, **step: Any) -> dict[str, Any]:
        """Return the data of a reset or a step of `env`, of which Minari gives what Gymnasium returned."""
        return {**super().__call__(env, **step), "info": env.unwrapped.episode_info()}
