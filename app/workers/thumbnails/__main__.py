"""Process that makes small pictures; run by ``app.runtime.worker_main``."""

from app.runtime.jobs import do_jobs
from app.workers.thumbnails.work import do_job

if __name__ == "__main__":
    do_jobs(do_job)
