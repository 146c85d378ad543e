"""Environment that alembic runs for each upgrade; ``migration.py`` passes the connection."""

from __future__ import annotations

from alembic import context

from app.storage.models import Base

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=Base.metadata,
    # SQLite alters tables by copying them.
    render_as_batch=True,
    # Our SQLite connections say BEGIN themselves, so DDL is rolled back with everything else.
    transactional_ddl=True,
)
with context.begin_transaction():
    context.run_migrations()
