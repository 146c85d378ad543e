from app.cli.parameters import parameter_table
from observer.guard.parameters import AllParameters


def test_the_table_has_one_row_for_every_parameter() -> None:
    rows = parameter_table().splitlines()[2:]
    assert [row.split("`")[1] for row in rows] == list(AllParameters().flat())
