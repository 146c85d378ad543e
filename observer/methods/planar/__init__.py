"""The paper's method: planar ego-motion, image transformation and residual flow."""
