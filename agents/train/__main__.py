"""Train a policy: `python -m agents.train [SETUP] --algo ppo`. Writes a run folder and prints its path."""

import sys

from agents.train.run import train
from agents.train.settings import read_settings


def main() -> None:
    """Read the settings from the command line and train."""
    try:
        print(train(read_settings(sys.argv[1:])))
    except (FileExistsError, TypeError, ValueError) as error:
        sys.exit(f"agents.train: {error}")
    except KeyboardInterrupt:
        print("agents.train: interrupted; --resume with the run folder goes on", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
