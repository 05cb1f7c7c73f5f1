# Each target sets up .venv first; that takes minutes once and no time after.
PYTHON := .venv/bin/python
SLOW ?=
ALL ?=
SEED ?=
TESTS ?=
TIER := $(if $(ALL),,$(if $(SLOW),not long,not slow and not long))
WORKERS ?= 2
DATASET ?=

.DEFAULT_GOAL := help
.PHONY: help setup demo test soak kills defects lint format typecheck docs bench build clean

help:  ## This list
	@grep -hE '^[a-z]+: .*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z]+):.*## /\1\t/' | expand -t 12

setup: ## Make .venv with everything that the other targets need
	@.ci/setup

demo: setup ## Five Pick episodes in our apartment: result table, video, picture (runs/demo)
	@.venv/bin/hab-eval run --agent hab_spa:spa_priv --env HabPick-v1 --scene-dataset apartment \
	  --episodes 5 --seed 0 --video 1 --force --out runs/demo

test: setup ## The quick tests; with SLOW=1 those of CI, with ALL=1 all; SEED=N: random order; TESTS=PATH: a part
	@$(PYTHON) -m pytest -q -n $(WORKERS) --dist loadfile --no-loadscope-reorder -m "$(TIER)" \
	  $(if $(SEED),--randomly-seed=$(SEED),-p no:randomly) $(if $(SLOW)$(ALL),--durations=60 --durations-min=10) $(TESTS)

soak: setup ## A million random and adversarial steps in all environments, as a test of what they stand
	@HAB_SOAK_STEPS=$(or $(STEPS),1000000) HAB_VECTOR_SOAK_STEPS=$(or $(VECTOR_STEPS),100000) \
	  $(PYTHON) -m pytest -q -n $(WORKERS) --log-cli-level=INFO tests/faults/test_soak.py tests/vector/test_vector_soak.py

kills: setup ## Kill every command that writes and its workers at 70 moments, as a test of what is left
	@HAB_KILLS=10 $(PYTHON) -m pytest -q -n 0 -k kill tests/faults/test_kills.py tests/faults/test_eval_runs.py

defects: setup ## Plant 30 defects in a copy; the tests must find each: make defects ROWS=a,b TIER=slow
	@$(PYTHON) tests/defects.py $(if $(ROWS),--rows $(ROWS)) $(if $(filter command line,$(origin TIER)),--tier $(TIER))

lint: setup ## Code style, spelling, sizes of files and functions
	@$(PYTHON) -m ruff check .
	@$(PYTHON) -m ruff format --check .
	@$(PYTHON) -m codespell_lib $$(git ls-files)
	@$(PYTHON) -m pytest -q tests/test_house_style.py

format: setup ## Put all Python files into the house format
	@$(PYTHON) -m ruff check --fix .
	@$(PYTHON) -m ruff format .

typecheck: setup ## Check the types
	@$(PYTHON) -m pyright

docs: setup ## The documentation site, in site-docs/; warnings and broken links are errors
	@NO_MKDOCS_2_WARNING=1 $(PYTHON) -m mkdocs build
	@echo "open site-docs/index.html"

bench: setup ## Steps per second, beside ManiSkill's own scene environment: make bench DATASET=PATH/replica_cad
	@test -n "$(DATASET)" || { echo 'make bench DATASET=PATH/replica_cad: it needs the real ReplicaCAD'; exit 2; }
	@mkdir -p runs
	@.venv/bin/hab-eval bench --suite sim --scene-dataset "$(DATASET)" --force --json runs/bench.json

build: setup ## Wheels of all packages, in dist/
	@rm -rf dist build */build */*/build; mkdir dist
	@$(PYTHON) -m pip wheel -q --no-deps --no-build-isolation --disable-pip-version-check -w dist \
	  $(addprefix ./,$(dir $(wildcard pyproject.toml */pyproject.toml */*/pyproject.toml)))
	@ls dist

clean: ## Remove .venv and everything made here
	rm -rf .venv build dist runs site-docs *.egg-info */*.egg-info */*/*.egg-info .pytest_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
