"""Process that draws steps; run by ``app.runtime.worker_main``."""

from app.runtime.jobs import do_jobs
from app.workers.steps.work import StepsWork

if __name__ == "__main__":
    do_jobs(StepsWork().do)
