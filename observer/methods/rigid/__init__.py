"""The rigid method: 3D ego-motion from stereo, and obstacles as bodies of points."""
