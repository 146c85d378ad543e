"""The simulated lab: a world, its rendering, its source and its ground truth.

- What there is: ``scenarios`` (YAML, by the classes of ``specs``), their ``variation`` by a seed,
  and the ``world`` made of both: ``bodies``, ``motion``, ``people``, ``held_board``.
- What the cameras see: ``rendering`` of ``facets`` (``drawing``, ``batches``, ``polygons``), with
  ``textures`` from ``painting``, ``lighting`` and ``reflections``; then ``imaging``, by ``rig``.
- What is known of it: ``source``, ``odometry``, ``truth`` by ``visibility``; ``export`` writes all
  as a stereo folder.
- ``robots``: firmware and vehicles that a driver reaches through a port.
"""
