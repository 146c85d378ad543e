"""Sources of stereo frames: cameras, video files, and folders in the layouts of ``folders``.

``contract`` says what a source does; ``observer.opening`` knows them all.
"""
