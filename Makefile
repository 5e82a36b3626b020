# make demo    environment + the main job: single obstacle, report, pictures and video in demo/
# make test    environment + all tests, on up to four cores
# make check   everything that CI runs
# PYTHON=...   the Python that .venv is made with (3.11 to 3.13)
PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/.installed
export PYTHON

.PHONY: env demo test check checks lint types imports doctest examples wheel release-check \
  attack docs gate baseline format lock clean
.DEFAULT_GOAL := env

env: $(STAMP)

$(STAMP): requirements.lock pyproject.toml tools/make_env.sh
	@sh tools/make_env.sh
	@touch $@

demo: env
	@$(BIN)/cableway run single-obstacle-2 --out demo

test: env
	@echo "All tests: some ten minutes on two cores, a few more the first time, while code is compiled."
	@$(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder -rs

check: test checks

checks: lint types imports doctest examples wheel docs gate

lint: env
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .

types: env
	@$(BIN)/pyright --pythonpath $(BIN)/python
	@$(BIN)/pyright --pythonpath $(BIN)/python --pythonplatform Windows

imports: env
	@$(BIN)/lint-imports --no-cache

doctest: env
	@$(BIN)/python -m pytest --doctest-modules --doctest-glob='*.md' --ignore-glob='docs/*.py' src/cableway docs

examples: env
	@$(BIN)/python -m pytest checks/test_examples.py

wheel: env
	@$(BIN)/python -m pytest checks/test_wheel.py

# Before a release: what is committed, on each Python, in a new environment from the lock, with compiled code made anew.
PYTHONS ?= python3.11 python3.12 python3.13
PARTS ?= wheel test
release-check:
	@sh tools/release_check.sh "$(PYTHONS)" "$(PARTS)"

# Hostile files, records, plants, methods and command lines, drawn from a seed; minutes, and no part of `make check`.
ATTACK := --seed 0 --count 2000
attack: env
	@$(BIN)/python -m checks.attack $(ATTACK)

# The documentation site, in site/; and the commands that its pages show, run.
docs: env
	@$(BIN)/sphinx-build --fail-on-warning --keep-going --nitpicky --fresh-env --quiet docs site
	@$(BIN)/python -m pytest checks/test_pages.py

# The quick suites against checks/baseline.json; `make baseline` takes what the last `make gate` found for the new one.
GATE := paper,clutter,dense,corridors,mazes,plants,sensing,table,faults,unconstrained,blocked
gate: env
	@rm -rf runs/gate
	@$(BIN)/cableway bench $(GATE) --out runs/gate --against checks/baseline.json

baseline:
	cp runs/gate/baseline.json checks/baseline.json

format: env
	@$(BIN)/ruff check --fix --select I .
	@$(BIN)/ruff format .

# The newest versions that pyproject.toml allows, one set for all Pythons and platforms.
lock: env
	@$(BIN)/uv pip compile pyproject.toml --extra dev --universal --python-version 3.11 --fork-strategy fewest \
	  --only-binary :all: --generate-hashes --upgrade --quiet --custom-compile-command 'make lock' -o requirements.lock

clean:
	rm -rf .venv demo dist site .pytest_cache .ruff_cache
