# `make run` and `make test` need python3 (3.11 or 3.12) and nothing else: both first build .venv from the pins in
# constraints.txt when it is missing or older than them. `make run` installs what it needs, `make test` the rest.

export MUJOCO_GL := disable
export PIP_DISABLE_PIP_VERSION_CHECK = 1

BIN := .venv/bin
STAMP := .venv/.built-from-pins
FULL := .venv/.with-extras
SITE := .venv/.with-docs
FITS := import sys; raise SystemExit(not (3, 11) <= sys.version_info < (3, 13))
ARGS ?=
COMMA := ,
# tests fill all cores by themselves: threads of linear algebra beside them only wait for each other (a fifth of the time)
ONE_BLAS_THREAD := OPENBLAS_NUM_THREADS=1
# and every process would compile all sources anew where Python is kept from keeping bytecode
TESTING := env -u PYTHONDONTWRITEBYTECODE $(ONE_BLAS_THREAD)

# uv installs what pip does in a fraction of the time. It is told of the places that pip is told of by variables; where
# it finds no way, pip does the same by whatever else it is set to. Of bytecode no more is written than of what a
# diagnosis imports, a part of all. Containers often keep Python from writing any (PYTHONDONTWRITEBYTECODE): each command
# would then compile the same sources for four seconds.
ifdef PIP_INDEX_URL
export UV_DEFAULT_INDEX ?= $(PIP_INDEX_URL)
endif
ifdef PIP_FIND_LINKS
export UV_FIND_LINKS ?= $(PIP_FIND_LINKS)
endif
IMPORTED := runner.commands._execute, runner.commands.diagnose, runner.report.html, runner.report.record, \
	runner.report.motion_figures, runner.viewer.rrd
PINNED := --quiet --constraint constraints.txt
install = { $(BIN)/uv pip install --python $(BIN)/python $(PINNED) $(1) 2>/dev/null || \
	$(BIN)/pip install --no-compile $(PINNED) $(1); }

.PHONY: run test slow check golden fuzz faults soak venv reference site wheel clean

run: $(STAMP)  ## The published experiment; other commands: make run ARGS="gap examples/..."
	@$(BIN)/python -m runner $(ARGS)

test: $(FULL)  ## Style, types, tests
	@$(MAKE) --no-print-directory --jobs=2 --output-sync=target compiled_laws check compiled_worlds
	@$(TESTING) $(BIN)/python -m pytest --numprocesses auto --dist worksteal $(ARGS)

slow: $(FULL)  ## Tests that take too long for every change: before a release
	@$(TESTING) $(BIN)/python -m pytest --numprocesses auto --dist worksteal -m slow $(ARGS)

check: $(FULL)
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/ty check

compiled_%: $(FULL)  # what every process of the tests would compile for itself: in two parts, and one beside the types
	@$(TESTING) $(BIN)/python -m tests.compiled $*

golden: $(FULL)  ## Every number of all golden verdicts; ARGS=--refresh writes them anew
	@$(BIN)/python -m tests.golden $(ARGS)

fuzz: $(FULL)  ## 100,000 spoilt inputs over all readers, some an hour; ARGS="count=1000 seed=7 kind=log_"
	@$(ONE_BLAS_THREAD) nice $(BIN)/python -m tests.fuzzing $(ARGS)

faults: $(FULL)  ## Every call that changes a file fails once, and the process ends at each once; ARGS="only=run every=10"
	@$(ONE_BLAS_THREAD) nice $(BIN)/python -m tests.faults $(ARGS)

soak: $(FULL)  ## 10,000 runs in one process, an hour at 240 Hz diagnosed; ARGS="runs=1000 minutes=5"
	@$(ONE_BLAS_THREAD) nice $(BIN)/python -m benchmarks.soak $(ARGS)

venv: $(FULL)  ## All that `make test` needs
	@echo "Now: source .venv/bin/activate"

reference: $(STAMP)  ## docs/reference/*.md from schemas and docstrings
	@$(BIN)/python docs/reference/make_reference.py

site: $(SITE)  ## docs/ as a site in site/, which opens from the disk
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet
	@echo "site/index.html"

wheel: $(FULL)  ## dist/runner-*.whl, for `pipx install`
	@$(BIN)/pip wheel --quiet --no-deps --no-build-isolation --wheel-dir dist .

$(STAMP): pyproject.toml constraints.txt
	@for python in $(PYTHON) python3 python3.12 python3.11; do \
		if $$python -c '$(FITS)' 2>/dev/null; then \
			echo "Building .venv with $$($$python --version) from constraints.txt ..." && \
			$$python -m venv --clear .venv && \
			{ $(BIN)/pip install --no-compile $(PINNED) uv || echo "without uv: pip takes longer" >&2; } && \
			$(call install,setuptools hatchling editables) && \
			$(call install,--no-build-isolation --editable .) && \
			$(BIN)/pip check --quiet && env -u PYTHONDONTWRITEBYTECODE $(BIN)/python -c 'import $(IMPORTED)' && \
			touch $(STAMP) && exit 0; \
			exit 1; \
		fi; \
	done; \
	echo "runner needs Python 3.11 or 3.12 as python3, python3.12 or python3.11 (or make PYTHON=/path/to/python)." >&2; \
	exit 1

$(FULL): $(STAMP)
	@$(call install,--no-build-isolation --editable '.[test$(COMMA)cluster$(COMMA)import]')
	@$(BIN)/pip check --quiet && touch $(FULL)

$(SITE): $(STAMP)
	@$(call install,--no-build-isolation --editable '.[docs]')
	@touch $(SITE)

clean:
	rm -rf .venv build dist site .pytest_cache .ruff_cache .hypothesis
