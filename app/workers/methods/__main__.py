"""Process that compares two methods; run by ``app.runtime.worker_main``."""

from app.runtime.jobs import do_jobs
from app.workers.methods.work import compare

if __name__ == "__main__":
    do_jobs(compare)
