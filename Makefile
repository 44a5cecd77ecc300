# Soft finger in water: from kinematics to the report. `make help` lists the targets.
# A façade: the program softfinger knows the stages, what is stale, and what every value may be.

LEVEL    ?= coarse
SCENE    ?= single_finger
NP       ?=
DOCS     ?= single_finger single_deflate cycle pinch
VALUES   := LEVEL NP COUPLED PIV ACCURACY BUDGET SLURM DPIV
TARGETS  := help setup study tradeoff compare fea validate docs test unit lint test-slurm faults \
    park bench-piv benchmark evidence audit clean

SHELL    := /bin/sh
PY       := .venv/bin/python
RUN      := .venv/bin/softfinger
READY    := .venv/.ready
DEV      := .venv/.dev
STUDY    ?=
PIP       = $1/bin/python -m pip install -q --disable-pip-version-check --require-hashes -r $2
SWITCHES := $(VALUES) SCENE STUDY DOCS PYTHON WM_PROJECT_DIR MAKEFLAGS
TYPED    := $(foreach v,$(.VARIABLES),$(if $(filter command,$(firstword $(origin $v))),$v))
UNKNOWN  := $(filter-out $(SWITCHES),$(TYPED))
$(if $(strip $(UNKNOWN)),$(error $(UNKNOWN): no such value; the values are $(SWITCHES)))
# Targets that use no value; the program refuses those that its commands do not use.
PLAIN    := help bench-piv benchmark park faults test-slurm audit lint unit clean
PLAIN    := $(filter $(PLAIN),$(MAKECMDGOALS))
UNUSED   := $(filter $(VALUES) SCENE STUDY DOCS,$(TYPED))
$(if $(filter 0,$(MAKELEVEL)),$(if $(PLAIN),$(if $(UNUSED),$(error \
    $(PLAIN) does not use $(UNUSED); omit it))))
# Values are text that make does not expand. Recipes read them from the environment, in quotes.
$(foreach v,$(filter-out MAKEFLAGS,$(TYPED)),$(eval override $v := $$(value $v)))
export TYPED SCENE STUDY DOCS $(VALUES)

# A name of another folder could be a command of the shell, or of make, or the name of a target.
SCENES   := $(filter-out $(TARGETS),$(shell printf '%s\n' cases/*/scene.toml \
    | LC_ALL=C sed -nE 's|^cases/([A-Za-z0-9_.-]+)/scene\.toml$$|\1|p'))
OTHERS   := $(filter-out $(SCENES:%=cases/%/scene.toml),$(wildcard cases/*/scene.toml))
$(if $(OTHERS),$(warning $(OTHERS): left out; rename the folder: A-Z a-z 0-9 _ . - and no target))

.DEFAULT_GOAL := help
.PHONY: $(TARGETS) $(SCENES)

help: ## this list
	@echo "make SCENE            everything from kinematics to report.html; SCENE is one of"
	@echo "                      $(SCENES)"
	@echo "make SCENE.STAGE      up to one stage ($(RUN) stages lists them); SCENE.view: for ParaView"
	@echo "    LEVEL=smoke (2-D, 1 minute), draft (3), coarse (default, 6), medium (14), fine and"
	@echo "    reference (hours)"
	@echo "    NP=4 MPI ranks"
	@echo "    ACCURACY=12% or BUDGET=10min: the cheapest, or the best, setting that was measured"
	@echo "    COUPLED=1: pressure and water make the motion together, COUPLED=0: it is prescribed"
	@echo "    PIV=0: a page of the flow alone, without camera and PIV, for less time"
	@echo "    SLURM=1: as batch jobs"
	@grep -hE '^[a-z-]+:.*## ' Makefile | sed -E 's/^([a-z-]+):.*## /make \1|/' \
	    | awk -F'|' '{printf "%-22s%s\n", $$1, $$2}'
	@echo "All commands and their options: $(RUN) --help"

setup: $(READY) ## Python environment and OpenFOAM, where missing
$(READY): requirements.lock softfinger/setup.sh softfinger/command.sh
	@TYPED= sh softfinger/setup.sh
	@touch $@

$(SCENES): $(READY)
	@$(RUN) run cases/$@

# Anything else: a stage of a scene, or a name that the program answers.
.DEFAULT:
	@[ -e $(READY) ] || $(MAKE) --no-print-directory setup
	@$(RUN) target '$(subst ','\'',$@)'

fea: $(READY) ## bending states of the actuator of SCENE
	@$(RUN) fea "cases/$$SCENE"

compare: $(READY) ## SCENE against laboratory data: DPIV=folder
	@$(RUN) compare "cases/$$SCENE"

study: $(READY) ## the runs of a table: STUDY=my_table.csv
	@$(RUN) study "$$STUDY" $(if $(filter SCENE,$(TYPED)),--scene "cases/$$SCENE")

tradeoff: $(READY) ## what accuracy costs (hours): ACCURACY and BUDGET need it
	@$(RUN) tradeoff "cases/$$SCENE"

validate: $(READY) ## flows of known answer, and convergence: docs/verification.md (hours)
	@$(RUN) study cases/validation/studies/validation.csv
	@$(RUN) study cases/validation/studies/convergence.csv
	@$(RUN) study cases/validation/studies/turek_hron.csv
	@$(RUN) study cases/single_finger/studies/tradeoff.csv \
	    --only draft,coarse,medium,fine
	@nice $(PY) -m docs.evidence.validation

docs: .venv-docs/.ready ## pictures and keys of the docs from runs of DOCS (an hour), and the site
	@$(PY) -m docs.evidence.reference
	@export TYPED="$(filter-out DOCS,$(TYPED))"; \
	for scene in $$DOCS; do $(RUN) run "cases/$$scene" || exit; done
	@$(PY) -m docs.evidence.pictures $$DOCS
	@$(PY) -m docs.evidence.pictures
	nice .venv-docs/bin/sphinx-build -q -W --keep-going -d .sphinx docs site
	@echo "site: $$PWD/site/index.html"

bench-piv: $(READY) ## PIV against its peers, and its limits: docs/piv_benchmarks.md (20 CPU min)
	@$(PY) -m docs.evidence.piv

evidence: .venv-docs/.ready ## all tables and pictures of the docs anew (a night; resumes)
	@$(PY) -m docs.evidence

faults: ## kills, full disks, damaged files, two makes at once
park: ## own fingers of every kind, and what must hold of them (hours; writes docs/park.md)
benchmark: ## PIV recordings with exact truth, for any program: benchmark/ (minutes)
faults park benchmark: $(READY)
	@$(PY) -m docs.evidence.$@

test-slurm: .venv-study/.ready ## a real Slurm of one node, started and stopped by the test (root)
	$(PY) -m pytest tests/slurm -p no:cacheprovider -s

audit: .venv-audit/.ready ## known vulnerabilities of all locked packages (pip-audit)
	.venv-audit/bin/python -m pip_audit --disable-pip --require-hashes \
	    $(patsubst %,-r %,$(wildcard requirements*.lock))

lint: $(DEV) ## ruff, mypy and the import rules
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy
	.venv/bin/lint-imports

test: lint ## the whole test suite
	$(PY) -m pytest -n "$${NP:-2}" --dist worksteal

unit: $(DEV) ## the tests that need no OpenFOAM
	$(PY) -m pytest tests/unit tests/analytic tests/golden

clean: ## everything generated by runs; the environments stay
	rm -rf cases/*/out site .sphinx .snakemake docs/api

$(DEV): requirements-dev.lock | $(READY)
	$(call PIP,.venv,$<)
	@touch $@

.venv-%/.ready: requirements-%.lock | $(READY)
	$(PY) -m venv .venv-$*
	$(call PIP,.venv-$*,$<)
	@touch $@
