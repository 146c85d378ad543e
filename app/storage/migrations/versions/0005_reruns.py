"""Link from a re-run to its original run."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"


def upgrade() -> None:
    # Not a foreign key: the original run may be deleted, and its id is shown even then.
    op.add_column("runs", sa.Column("rerun_of", sa.String(64), nullable=True))


def downgrade() -> None:
    op.drop_column("runs", "rerun_of")
