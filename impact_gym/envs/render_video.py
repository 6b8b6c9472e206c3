"""Films of episodes in slow motion, through Gymnasium's own recorder; needs moviepy beside the extra `render`."""

from typing import Any

from gymnasium.wrappers import RecordVideo


class SlowMotionVideo(RecordVideo[Any, Any]):
    """Gymnasium's `RecordVideo`, but with all pictures of a step where that keeps the last one.

    Use it as that one, on an environment made with `render_mode="rgb_array_list"`; in mode "rgb_array", or in
    `RecordVideo` itself, a film has a picture a step: about twice slower than life, and a contact is over in a few.

    Example:
        >>> env = gym.make("ImpactApproach-v0", render_mode="rgb_array_list")
        >>> env = SlowMotionVideo(env, "films", episode_trigger=lambda episode: True)
        >>> # play episodes as ever, then env.close(); films/rl-video-episode-0.mp4 is the first
    """

    def _capture_frame(self) -> None:
        frames: Any = self.env.render()
        self.recorded_frames += frames if isinstance(frames, list) else [frames]
