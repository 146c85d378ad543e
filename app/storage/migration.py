"""Migration of a database to the tables of this version.

Migrations live inside the package and run at open; there is no alembic.ini. To add one: change
``models.py``, copy the newest file of ``migrations/versions``, give it the next number and write
both directions; ``tests/app/storage/test_migration.py`` compares the result with the models.
"""

from __future__ import annotations

from pathlib import Path

import structlog
from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Engine, inspect

from app.storage.copying import copy_tables
from app.storage.errors import StorageError
from app.storage.integrity import copy_database, name_beside
from app.storage.server_locks import lock_whole

log = structlog.get_logger(__name__)

MIGRATIONS = Path(__file__).parent / "migrations"


def alembic_config(migrations: Path = MIGRATIONS) -> Config:
    config = Config()
    config.set_main_option("script_location", str(migrations).replace("%", "%%"))
    return config


def upgrade(engine: Engine, file: Path | None, migrations: Path = MIGRATIONS) -> Path | None:
    """Apply missing migrations in one transaction; return the path of the old database's copy.

    Args:
        file: base name of the copy made before an actual migration: the SQLite file itself, or for
            a database server the name that it would have. None: no copy.

    Raises:
        StorageError: the database was written by a newer version, or is not one of ours.
    """
    config = alembic_config(migrations)
    script = ScriptDirectory.from_config(config)
    with engine.connect() as connection:
        present = MigrationContext.configure(connection).get_current_revision()
        foreign = present is None and bool(inspect(connection).get_table_names())
    on_server = engine.dialect.name != "sqlite"
    where = engine.url.render_as_string(hide_password=True) if on_server else engine.url.database
    if foreign:
        raise StorageError(
            f"the database {where} belongs to another program; choose another file or database"
        )
    if present == script.get_current_head():
        return None
    if present is not None and present not in {each.revision for each in script.walk_revisions()}:
        raise StorageError(
            f"the database {where} was written by a newer version of dynamic-observer "
            f"(its revision is {present}); upgrade dynamic-observer or choose another file"
        )
    copy = None
    if file is not None and present is not None:
        copy = name_beside(file, f"before-migration-from-{present}")
        if on_server:
            copy_tables(engine, copy)
        else:
            copy_database(file, copy)
    with engine.execution_options(writes=True).begin() as connection:
        # Another server may be migrating the same database; alembic checks again.
        lock_whole(connection)
        config.attributes["connection"] = connection
        command.upgrade(config, "head")
    log.info(
        "database_migrated",
        database=where,
        before=present,
        after=script.get_current_head(),
        copy=str(copy) if copy else None,
    )
    return copy
