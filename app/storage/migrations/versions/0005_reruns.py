"""Link from a re-run to its original run.

Revision: 0005, after 0004
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    # Not a foreign key: the original run may be deleted, and its id is shown even then.
    op.add_column("runs", sa.Column("rerun_of", sa.String(64), nullable=True))


def downgrade() -> None:
    op.drop_column("runs", "rerun_of")
