# Two commands do everything on a fresh machine: `make demo` and `make test`.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
DEMO ?= demo-out
WORKERS ?= 3
ALONE := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 HYDRO_THREADS=1

.PHONY: help install demo quick test mutants fuzz kills browser lint types docs site wheel release wheel-test clean

help:            ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*##/\t/' | expand -t 12

install: $(STAMP)     ## create .venv and install hydro with its development tools

$(STAMP): pyproject.toml
	@test -x $(BIN)/python || { echo "creating $(VENV)"; $(PYTHON) -m venv $(VENV); }
	@echo "installing hydro and its dependencies into $(VENV) (a few minutes the first time)"
# Python compiles a module when it is first imported: most of 20,000 never are. Those of the tests are compiled
# here, beside the kernels, as otherwise each worker would compile all of them at the same time.
	@$(BIN)/python -m pip install --quiet --no-compile --editable ".[dev]"
	@$(BIN)/python -m pytest --collect-only -qq >/dev/null & modules=$$!; \
	$(BIN)/python -m benchmarks.kernels & kernels=$$!; \
	$(BIN)/python -m hydro.study.kernels && wait $$kernels && wait $$modules
	@touch $@

demo: $(STAMP)        ## the whole story on bundled recordings; writes into demo-out
	@$(BIN)/hydro demo $(DEMO)

# The rules between modules, the schemas, every effect, and one study from a recording to its explanation.
QUICK := tests/test_layers.py tests/test_effect_names.py tests/io/test_schema.py tests/core/effects tests/core/explanation

quick: $(STAMP)       ## layers, schemas, effects and one study: within two minutes
	$(ALONE) $(BIN)/python -m pytest -n $(WORKERS) --dist worksteal $(QUICK)

# Each worker has one thread: threads of the linear algebra, or of hydro itself, would only wait for one another.
# Three workers keep two processors busy, since a worker often waits for another process.
test: $(STAMP)        ## the whole test suite on three workers, for two processors
	$(ALONE) $(BIN)/python -m pytest -n $(WORKERS) --dist worksteal

mutants: $(STAMP)     ## change 200 operators and constants one at a time and see which no test notices: two hours
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.mutants --workers 2

# Each run damages other files; HYDRO_FUZZ_SEED, which is printed, repeats those of the readers.
fuzz: $(STAMP)        ## almost right files of every kind through every command, some ten minutes
	@seed=$${HYDRO_FUZZ_SEED:-$$(date +%s)}; echo "HYDRO_FUZZ_SEED=$$seed"; \
	HYDRO_FUZZ=400 HYDRO_FUZZ_SEED=$$seed HYPOTHESIS_PROFILE=fuzz \
	$(BIN)/python -m pytest -n 0 -s tests/fuzz tests/io/readers/test_damage.py

kills: $(STAMP)       ## kill every long command at random moments, a hundred times: half an hour
	$(BIN)/python -m benchmarks.kills

browser:              ## Chromium for the tests of the report, where apt can install it; else they skip
	@command -v chromium chromium-browser >/dev/null || \
	{ test "$$(id -u)" = 0 && command -v apt-get >/dev/null && apt-get update -qq && \
	apt-get install -y -qq --no-install-recommends chromium >/dev/null; } || \
	echo "no chromium, and no rights to install it: the tests in a browser will be skipped"

lint: $(STAMP)        ## style and import rules
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP)       ## static types: strict in hydro/core and hydro/io
	$(BIN)/mypy

docs: $(STAMP)        ## regenerate the pages that are made from code, result tables and the tutorial's commands
	$(BIN)/python docs/generate_cli.py
	$(BIN)/python docs/generate_theory.py
	$(BIN)/python docs/draw_layouts.py
	$(BIN)/python docs/draw_report.py
	$(BIN)/python docs/draw_proof.py
	$(BIN)/python docs/generate_benchmarks.py
	$(BIN)/python docs/generate_tutorial.py

site: $(STAMP)        ## build the documentation into site/, to be opened from disk
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet

wheel: $(STAMP)       ## build dist/*.whl
	$(BIN)/python -m build --wheel

# Every file in them has the time of the last commit, so that the same commit gives the same bytes.
release: $(STAMP)     ## build dist/*.whl and dist/*.tar.gz from the committed files, and check them
	rm -rf dist
	SOURCE_DATE_EPOCH=$$(git log -1 --format=%ct) $(BIN)/python -m build
	$(BIN)/python -m twine check --strict dist/*

wheel-test: $(STAMP)  ## install the wheel alone, outside the checkout, and run it
	$(BIN)/python -m pytest tests/test_wheel.py

clean:                ## remove everything that the targets above made
	rm -rf $(VENV) $(DEMO) demo.log checks.log types.log dist build site .pytest_cache .mypy_cache .ruff_cache .hypothesis .benchmarks
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
