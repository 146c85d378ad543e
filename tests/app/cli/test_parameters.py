from pathlib import Path

from app.cli.parameters import parameter_table
from observer.guard.parameters import AllParameters

README = Path(__file__).parents[3] / "README.md"


def test_the_readme_has_the_table_that_the_declaration_gives() -> None:
    assert parameter_table() in README.read_text(), (
        "put the output of `dynamic-observer parameters --markdown` into the README"
    )


def test_the_table_has_one_row_for_every_parameter() -> None:
    rows = parameter_table().splitlines()[2:]
    assert [row.split("`")[1] for row in rows] == list(AllParameters().flat())
