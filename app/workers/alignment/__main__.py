"""Process that aligns repeatedly; run by ``app.runtime.worker_main``."""

from app.runtime.jobs import do_jobs
from app.workers.alignment.work import Aligner

if __name__ == "__main__":
    aligner = Aligner()
    do_jobs(lambda job, _: aligner.solve(job))
