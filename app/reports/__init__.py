"""The paper's figures and tables redone from the recording of a run."""
