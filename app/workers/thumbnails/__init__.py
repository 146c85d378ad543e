"""Small pictures of sources, made in a separate process.

Painting a scenario's textures takes a second of a core, and a folder may hold anything.
"""
