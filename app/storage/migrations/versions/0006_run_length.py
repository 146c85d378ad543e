"""Length of a run, and where its time begins."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"


def upgrade() -> None:
    # Unknown for earlier runs; the server reads it from their recordings.
    op.add_column("runs", sa.Column("begin_s", sa.Float(53), nullable=True))
    op.add_column("runs", sa.Column("duration_s", sa.Float(53), nullable=True))


def downgrade() -> None:
    op.drop_column("runs", "duration_s")
    op.drop_column("runs", "begin_s")
