"""Keys of a scenario: one pydantic class for each thing that a scenario can contain."""
