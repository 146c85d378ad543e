"""The method's stages, one file each; none knows another."""
