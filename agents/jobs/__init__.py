"""Lists of independent jobs: on this machine's cores, or on a Ray cluster, with the same numbers bit for bit.

A job names a function and its arguments as plain data. `gather` yields the results as they come and keeps each in a
folder; what is there is never computed again, so a batch that was stopped continues when it is run again.
"""

from agents.jobs.gathering import JobsFailedError, gather, gather_all
from agents.jobs.job import Failure, Job, Result
from agents.jobs.sources import digest_of

__all__ = ["Failure", "Job", "JobsFailedError", "Result", "digest_of", "gather", "gather_all"]
