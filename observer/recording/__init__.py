"""Recordings: everything that happened in a run, in one MCAP file that other tools can open.

- Written: ``encoder`` makes messages of events, ``writer`` stores them as they come, ``ring`` keeps
  the last half minute; ``container`` is the file.
- Messages: ``topics`` lists them; ``payloads`` are our own, ``foxglove``, ``drawn`` and
  ``camera_frames`` those that other tools draw.
- Read: ``reader``, on the index of ``contents``; ``source`` plays a recording as a source,
  ``replay`` observes it again, ``run_times`` puts it on the run's clock.
"""
