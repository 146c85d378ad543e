"""History of runs: tags, notes, deletion with undo, recordings, truths, alignment."""

from __future__ import annotations

import unicodedata

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"

_RUNS = sa.table(
    "runs", sa.column("id", sa.String), sa.column("name", sa.String), sa.column("searched", sa.Text)
)


def upgrade() -> None:
    op.create_table(
        "truths",
        sa.Column("id", sa.String(64), nullable=False),
        sa.Column("name", sa.String(200), nullable=False),
        sa.Column("format", sa.String(40), nullable=False),
        sa.Column("file", sa.String(200), nullable=False),
        sa.Column("info", sa.JSON(), nullable=False),
        sa.Column("created_at", sa.String(32), nullable=False),
        sa.Column("listed", sa.Boolean(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_truths"),
    )
    # Columns are added one by one: otherwise SQLite would have the table copied, and dropping the
    # old one would delete all speeds with it.
    for column in (
        sa.Column("notes", sa.Text(), nullable=False, server_default=""),
        sa.Column("searched", sa.Text(), nullable=False, server_default=""),
        sa.Column("deleted_at", sa.String(32), nullable=True),
        sa.Column("rig", sa.Text(), nullable=True),
        sa.Column("record", sa.String(20), nullable=True),
        sa.Column("recording_bytes", sa.BigInteger(), nullable=True),
        sa.Column("alignment", sa.JSON(), nullable=True),
    ):
        op.add_column("runs", column)
    # Alembic cannot add a column together with its reference.
    op.execute(
        "ALTER TABLE runs ADD COLUMN truth_id VARCHAR(64) "
        "CONSTRAINT fk_runs_truth_id_truths REFERENCES truths (id)"
    )
    op.create_index("ix_runs_deleted_at", "runs", ["deleted_at"])
    op.create_index("ix_runs_truth_id", "runs", ["truth_id"])
    op.create_table(
        "run_tags",
        sa.Column("run_id", sa.String(64), nullable=False),
        sa.Column("tag", sa.String(200), nullable=False),
        sa.ForeignKeyConstraint(
            ["run_id"], ["runs.id"], name="fk_run_tags_run_id_runs", ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("run_id", "tag", name="pk_run_tags"),
    )
    op.create_index("ix_run_tags_tag", "run_tags", ["tag"])
    op.add_column("speeds", sa.Column("body", sa.String(200), nullable=True))
    connection = op.get_bind()
    for row in connection.execute(sa.select(_RUNS.c.id, _RUNS.c.name)).all():
        # Same as app/storage/searching.py today; a migration must not change with it.
        searched = unicodedata.normalize("NFKC", row.name).casefold()
        connection.execute(_RUNS.update().where(_RUNS.c.id == row.id).values(searched=searched))


def downgrade() -> None:
    op.drop_column("speeds", "body")
    op.drop_table("run_tags")
    op.drop_index("ix_runs_truth_id", "runs")
    op.drop_index("ix_runs_deleted_at", "runs")
    for column in ("notes", "searched", "deleted_at", "rig", "record", "recording_bytes"):
        op.drop_column("runs", column)
    op.drop_column("runs", "alignment")
    op.drop_column("runs", "truth_id")
    op.drop_table("truths")
