"""Timed velocities for robots, as data.

``library`` holds those that come with the project, ``profile_file`` reads and writes them as YAML,
``playing`` samples the velocity of each robot at an instant. Users know them as *programmes*.
"""
