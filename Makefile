# `make help` lists the targets.
.DEFAULT_GOAL := help
.PHONY: help setup demo test fast lint format figures api docs wheels lock audit clean

FIGURES_OUT ?= runs/figures
ENGINE ?= mujoco
DEMO_VENV = $(if $(filter sapien,$(ENGINE)),.venv,.venv-light)
DEMO_OUT ?= runs/demo
DEMO_TASKS ?= 1
DEMO_LONG ?= PlaceGolfBallIntoDrawer
DEMO_EPISODES ?= 2
DEMO_SEED ?= 3

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z]+:.*## / {printf "  make %-8s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: ## make .venv/ ready: packages, extension, command line, Vulkan driver
	@scripts/setup.sh

demo: ## design a task, take a long one from the library, verify and record both in MuJoCo (ENGINE=sapien: in SAPIEN)
	@scripts/setup.sh $(if $(filter sapien,$(ENGINE)),,light)
	@$(DEMO_VENV)/bin/gensim2 run-pipeline --engine $(ENGINE) --assets builtin --from-empty --num-tasks $(DEMO_TASKS) --stored-task $(DEMO_LONG) \
		--episodes $(DEMO_EPISODES) --seed $(DEMO_SEED) --library none --out $(DEMO_OUT) --resume

test: ## setup, then everything that must hold: format, lint, types, Rust and Python tests
	@scripts/check.sh

fast: setup ## linters and the quick tests of every room: a minute, while you work
	@.venv/bin/ruff check .
	@.venv/bin/ruff format --check .
	@.venv/bin/python -m pytest -q -m fast

lint: setup ## mend what the formatters and linters can
	@cargo fmt --all
	@.venv/bin/ruff check --fix .
	@.venv/bin/ruff format .

api: setup ## write the API pages of the solver to dist/api
	@.venv/bin/python -W error -W "ignore:Cannot determine where gensim2_kpam.ContactWindow" -m pdoc --docformat google \
		--output-directory dist/api gensim2_kpam

docs: setup ## the documentation as a site in dist/site: guides, command line, Python, tables, search; links checked
	@PATH=$$PATH:.tools/bin VIRTUAL_ENV=$$PWD/.venv uv pip install --quiet --no-deps --require-hashes -r requirements-docs.lock
	@NO_MKDOCS_2_WARNING=1 .venv/bin/mkdocs build --quiet
	@.venv/bin/python scripts/check_site.py dist/site

# One target folder: what both are made of is compiled once, and not anew where a build stands.
wheels: export CARGO_TARGET_DIR = $(CURDIR)/target
wheels: export VIRTUAL_ENV = $(CURDIR)/.venv
wheels: setup ## wheels and source distributions of gensim2, gensim2-kpam and gensim2-robot in dist/wheels
	@.venv/bin/maturin build --quiet --release --sdist --out dist/wheels
	@cd crates/python && $(VIRTUAL_ENV)/bin/maturin build --quiet --release --sdist --out $(CURDIR)/dist/wheels
	@PATH=$$PATH:.tools/bin uv build --quiet --no-build-isolation --out-dir dist/wheels python
	@ls -1 dist/wheels

LOCK = PATH=$$PATH:.tools/bin uv pip compile pyproject.toml --universal --python-version 3.11 --fork-strategy fewest \
	--generate-hashes --no-emit-index-url --custom-compile-command "make lock" --quiet

lock: ## pin what pyproject.toml asks for in requirements.lock and requirements-docs.lock, keeping pins that still fit
	@$(LOCK) --extra sim --extra dev --output-file requirements.lock
	@$(LOCK) --extra docs --constraints requirements.lock --output-file requirements-docs.lock

audit: ## known faults, licences and sources of all dependencies; skips, with one line, what needs an unreachable network
	@scripts/audit.sh

figures: setup ## run anew what made the figures (FIGURES_OUT, days of one core), with real objects in ASSETS; then the tables
	@.venv/bin/python benchmarks/figures.py --remake $(FIGURES_OUT) --assets $(ASSETS) --page $(FIGURES_OUT)/by_instance.html
	@.venv/bin/python benchmarks/results_table.py --into README.md docs/results/engines.md docs/results/physics.md docs/results/tasks*.md

clean: ## remove what was built; keeps .venv/ and runs/
	@rm -rf target dist python/*.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis python/gensim2_kpam/_native*.so .venv/.gensim2-extension
