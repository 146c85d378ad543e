"""Small pictures of sources, made in a separate process.

Painting a scenario's textures takes a second of CPU time, and a folder may hold anything.
"""
