"""Process that re-runs a recording; run by ``app.runtime.worker_main``."""

from app.runtime.jobs import do_jobs
from app.workers.rerun.work import rerun

if __name__ == "__main__":
    do_jobs(rerun)
