"""The rigid method: ego-motion in space by stereo, and obstacles as bodies of points."""
