"""The paper's method step by step, shown of a frame of any source that can be opened again."""
