"""Dense evidence: what stands out of the ground, and what entered space that was seen to be free.

It works on *cells*, the pixels of a smaller image, see ``observer.methods.rigid.dense.grid``.
"""
