# Every target sets itself up in .venv from uv.lock; a second run installs nothing.
.DELETE_ON_ERROR:
.PHONY: demo docs test test-slow lint format smoke verify bench bench-measure bench-footage bench-guards bench-unseen bench-diagnose bench-diagnose-independent bench-diagnose-bulk bench-decks bench-calibrate bench-search bench-campaign bench-sweep bench-verdicts bench-review release-check faults fuzz soak clean

PYTHON ?= python3
BIN := .venv/bin
READY := .venv/.ready

demo: $(READY)
	$(BIN)/rigtwin demo --out out/demo

# the documentation as pages in out/site: notebooks are run, links checked
docs: $(READY)
	UV_PROJECT_ENVIRONMENT=.venv $(BIN)/uv sync --frozen --inexact --quiet --group docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

# compiled modules are kept: many tests start processes, each of which would compile them anew
test smoke: export PYTHONDONTWRITEBYTECODE :=

test: $(READY)
	$(BIN)/pytest -q -n 2 --dist loadscope -m "not slow"

test-slow: $(READY)
	$(BIN)/pytest -q -m slow

# what is checked for the words to avoid (docs/word_list.txt)
PLAIN := *.py *.md benchmarks commands compare docs lab measure review sample_media sim tests training

# modules of which every public name has a numpydoc docstring ([tool.numpydoc_validation] in pyproject.toml)
DOCUMENTED := api.py lab/*.py lab/*/*.py measure/*/measurement.py sim/*.py sim/pile/*.py sim/run/*.py sim/output/*.py \
	sim/decks/*.py $(addprefix sim/,effects/__init__.py effects/effect.py effects/validate.py engine/time_step.py) \
	compare/*.py compare/campaign/*.py compare/diagnose/*.py compare/diagnose/bulk/diagnose_bulk.py compare/report/*.py \
	$(patsubst %,compare/twins/%.py,by_name custom imported matched registry rig_entry run_warnings twin)

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-cache
	$(BIN)/mypy
	$(BIN)/python benchmarks/measure/thresholds.py --check
	$(BIN)/python benchmarks/lab_keys.py --check
	$(BIN)/numpydoc lint $(DOCUMENTED)
	$(BIN)/codespell -D docs/word_list.txt --skip "docs/word_list.txt,*.onnx" $(PLAIN)

format: $(READY)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/python benchmarks/measure/thresholds.py
	$(BIN)/python benchmarks/lab_keys.py

# every benchmark with few particles, frames and repetitions: shows that it runs; its figures mean nothing
smoke: $(READY)
	$(BIN)/python benchmarks/smoke.py

# SEED=7 make verify: another start of whatever is random
verify: $(READY)
	$(BIN)/python benchmarks/engine/verify.py

bench: $(READY)
	$(BIN)/python benchmarks/engine/speed.py

# trackpy, which stands in its table, comes with the group `bench`
bench-measure: $(READY)
	UV_PROJECT_ENVIRONMENT=.venv $(BIN)/uv sync --frozen --inexact --quiet --group bench
	$(BIN)/python benchmarks/measure/accuracy.py

# SEED=7 COUNT=3 make bench-footage: other clips, three of each hardness
bench-footage: $(READY)
	$(BIN)/python benchmarks/measure/hard_footage.py $(if $(COUNT),--count $(COUNT))
	$(BIN)/python benchmarks/measure/hard_bulk.py $(if $(COUNT),--count $(COUNT))

# SEED=7 COUNT=100 make bench-unseen: photos of heaps and beds by a path tracer, a minute each, and as many films of
# drops, tilts and pendulums by VTK, half a minute each; interrupted runs go on
bench-unseen: $(READY)
	UV_PROJECT_ENVIRONMENT=.venv $(BIN)/uv sync --frozen --inexact --quiet --group unseen
	$(BIN)/python benchmarks/unseen/render.py out/unseen/$(or $(SEED),1) --seed $(or $(SEED),1) --count $(or $(COUNT),40)
	$(BIN)/python benchmarks/unseen/films.py out/unseen/$(or $(SEED),1) --seed $(or $(SEED),1) --count $(or $(COUNT),40)
	$(BIN)/python benchmarks/measure/unseen.py --media out/unseen/$(or $(SEED),1)
	$(BIN)/python benchmarks/measure/unseen.py --media out/unseen/$(or $(SEED),1) --stated

# COUNT=1 make bench-guards: one guard of measure after the other switched off; about two hours
bench-guards: $(READY)
	$(BIN)/python benchmarks/measure/guards.py --json out/guards.json $(if $(COUNT),--count $(COUNT))

# SEED=7 COUNT=40 make bench-diagnose: other labs, fewer of them
bench-diagnose: $(READY)
	$(BIN)/python benchmarks/diagnose/verdicts.py $(if $(COUNT),--count $(COUNT))

# SEED=7 COUNT=40 make bench-diagnose-independent: labs whose physics shares no code with the models of the diagnosis
bench-diagnose-independent: $(READY)
	$(BIN)/python benchmarks/diagnose/independent.py $(if $(COUNT),--count $(COUNT))

# SEED=7 COUNT=8 make bench-diagnose-bulk: labs of piles, packings, drums and hoppers made by LIGGGHTS; continues where it stopped
bench-diagnose-bulk: $(READY)
	$(BIN)/python benchmarks/diagnose/bulk.py

# decks of four rigs run by LIGGGHTS, LAMMPS and Yade, where they are installed; about ten minutes
bench-decks: $(READY)
	$(BIN)/python benchmarks/engine/decks.py

# SEED=7 COUNT=4 make bench-calibrate: known parameters recovered from simulated labs, five to ten minutes a lab; goes on
bench-calibrate: $(READY)
	$(BIN)/python benchmarks/calibrate/recovery.py

# simulations needed beside a grid, random search and CMA-ES (the package cma of the group bench); half an hour
bench-search: $(READY)
	$(BIN)/python benchmarks/calibrate/search_cost.py

# SEED=7 COUNT=20 make bench-campaign: a campaign killed COUNT times, and one of two processes; two minutes
bench-campaign: $(READY)
	$(BIN)/python benchmarks/campaign/kills.py

# COUNT=4 make bench-sweep: packings of 3000 beads (all 56 without COUNT) by rigtwin and by LIGGGHTS; goes on
bench-sweep: $(READY)
	$(BIN)/python benchmarks/campaign/sweep_speed.py

# SEED=7 make bench-verdicts: how often right and wrong twins are called different with one repetition; half a minute
bench-verdicts: $(READY)
	$(BIN)/python benchmarks/compare/verdict_rates.py

# where Chromium is installed; a minute
bench-review: $(READY)
	$(BIN)/python benchmarks/review/page_speed.py

# wheel and source archive installed outside the repository, under each Python of 3.11 to 3.13 that is here; ten minutes
release-check: $(READY)
	$(BIN)/python benchmarks/release.py

# SEED=7 COUNT=10 make faults: 60 kills and 24 double Ctrl-C of six commands, a full disk, two runs in one folder; half an hour
faults: $(READY)
	$(BIN)/python benchmarks/faults.py

# SEED=7 COUNT=10000 make fuzz: damaged and absurd input of every kind; twenty minutes
fuzz: $(READY)
	$(BIN)/python benchmarks/fuzz.py

# COUNT=1000 make soak: a thousand measurements and two hundred twins in one process; an hour
soak: $(READY)
	$(BIN)/python benchmarks/soak.py

clean:
	rm -rf .venv .typing out build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# uv is fetched into .venv itself, so nothing but Python need be on the machine; the link lets type checkers see the
# repository root under its package name; byte code is made once here, where else every start might make it anew
$(READY): uv.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' \
		|| { echo "rigtwin needs Python 3.11 to 3.13; name one with: make PYTHON=python3.11" >&2; exit 1; }
	@echo "installing rigtwin into .venv, once: 1.2 GB, a minute or some"
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	test -x $(BIN)/uv || $(BIN)/python -m pip install --quiet --disable-pip-version-check 'uv==0.13.8'
	UV_PROJECT_ENVIRONMENT=.venv UV_COMPILE_BYTECODE=1 $(BIN)/uv sync --frozen --inexact --quiet
	mkdir -p .typing && ln -sfn .. .typing/rigtwin
	touch $@
