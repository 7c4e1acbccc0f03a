# `make run` and `make test` need python3 (3.11 or 3.12) and nothing else: both first build .venv from the pins
# in constraints.txt when it is missing or older than them.

export MUJOCO_GL ?= disable
export PIP_DISABLE_PIP_VERSION_CHECK = 1

BIN := .venv/bin
STAMP := .venv/.built-from-pins
FITS := import sys; raise SystemExit(not (3, 11) <= sys.version_info < (3, 13))
ARGS ?=
# tests fill all cores by themselves: threads of linear algebra beside them only wait for each other (a fifth of the time)
ONE_BLAS_THREAD := OPENBLAS_NUM_THREADS=1

.PHONY: run test check golden fuzz faults soak venv clean

run: $(STAMP)  ## The published experiment; other commands: make run ARGS="gap examples/..."
	@$(BIN)/python -m runner $(ARGS)

test: $(STAMP) check  ## Style, types, tests
	@$(ONE_BLAS_THREAD) $(BIN)/python -m pytest --numprocesses auto --dist worksteal $(ARGS)

check: $(STAMP)
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/pyright

golden: $(STAMP)  ## Every number of all golden verdicts; ARGS=--refresh writes them anew
	@$(BIN)/python -m tests.golden $(ARGS)

fuzz: $(STAMP)  ## 100,000 spoilt inputs over all readers, some an hour; ARGS="count=1000 seed=7 kind=log_"
	@$(ONE_BLAS_THREAD) nice $(BIN)/python -m tests.fuzzing $(ARGS)

faults: $(STAMP)  ## Every call that changes a file fails once, and kills once; ARGS="only=run every=10"
	@$(ONE_BLAS_THREAD) nice $(BIN)/python -m tests.faults $(ARGS)

soak: $(STAMP)  ## 10,000 runs in one process, an hour at 240 Hz diagnosed; ARGS="runs=1000 minutes=5"
	@$(ONE_BLAS_THREAD) nice $(BIN)/python -m benchmarks.soak $(ARGS)

venv: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	@for python in $(PYTHON) python3 python3.12 python3.11; do \
		if $$python -c '$(FITS)' 2>/dev/null; then \
			echo "Building .venv with $$($$python --version) from constraints.txt ..." && \
			$$python -m venv --clear .venv && \
			$(BIN)/pip install --quiet --constraint constraints.txt setuptools hatchling editables && \
			$(BIN)/pip install --quiet --constraint constraints.txt --no-build-isolation --editable '.[test,cluster,import]' && \
			$(BIN)/pip check --quiet && touch $(STAMP) && exit 0; \
			exit 1; \
		fi; \
	done; \
	echo "runner needs Python 3.11 or 3.12 as python3, python3.12 or python3.11 (or make PYTHON=/path/to/python)." >&2; \
	exit 1

clean:
	rm -rf .venv build dist .pytest_cache .ruff_cache .hypothesis
