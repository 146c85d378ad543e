"""The paper's method step by step, on a frame of any source that can be reopened."""
