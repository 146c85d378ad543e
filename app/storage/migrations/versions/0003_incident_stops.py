"""Measured stops of each robot that an incident stopped."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"


def upgrade() -> None:
    op.create_table(
        "incident_stops",
        sa.Column("incident_id", sa.Integer(), nullable=False),
        sa.Column("role", sa.String(20), nullable=False),
        sa.Column("zero_ms", sa.Float(53), nullable=True),
        sa.Column("stood_ms", sa.Float(53), nullable=True),
        sa.Column("distance_m", sa.Float(53), nullable=True),
        sa.Column("speed_mps", sa.Float(53), nullable=True),
        sa.Column("separation_m", sa.Float(53), nullable=True),
        sa.ForeignKeyConstraint(
            ["incident_id"],
            ["incidents.id"],
            name="fk_incident_stops_incident_id_incidents",
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("incident_id", "role", name="pk_incident_stops"),
    )


def downgrade() -> None:
    op.drop_table("incident_stops")
