"""The commands of ``dynamic-observer``, one file each."""
