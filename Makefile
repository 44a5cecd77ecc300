# Soft finger in water: from kinematics to the report. `make help` lists what there is.
LEVEL ?= coarse
CORES := $(shell nproc 2>/dev/null || echo 1)
NP    ?= $(shell n=$(CORES); [ $$n -gt 4 ] && n=4; echo $$n)
JOBS  := $(shell n=$(NP); [ $$n -gt $(CORES) ] && n=$(CORES); echo $$n)
HOSTS ?=
COLLATED ?=
QUIET ?=
CASES ?= cases
SLURM ?=
ACCURACY ?=
BUDGET ?=

# The sheet's vortices are found while its images are still rendered.
MAKEFLAGS += -j$(JOBS)

SHELL  := /bin/sh
PY     := .venv/bin/python
SCENES := $(patsubst $(CASES)/%/scene.toml,%,$(wildcard $(CASES)/*/scene.toml))
SCENE  ?= single_finger
# scenes that a comparison with a laboratory made: runs beside the nominal one
RUNS   := $(patsubst $(CASES)/%/scene.toml,%,$(wildcard $(addprefix $(CASES)/*/out/*/,inputs/*/scene.toml virtual/*/scene.toml \
            lab/*/measured/scene.toml lab/*/measured/out/*/inputs/*/scene.toml)))
STAGES := kinematics mesh case run sheet images piv vortices compare report
READY  := .venv/.ready
FLAGS  := $(if $(QUIET),--quiet)

.SUFFIXES:
.SECONDARY:
.PHONY: help setup study tradeoff predict test-slurm test lint unit fea fea-studies pinch-studies docs compare compare-measured virtual-lab virtual-lab-study lab-register lab-sheets study-sheets validate convergence clean clean-all bench-piv piv-limits bench-steps stability faults fuzz $(SCENES) $(foreach s,$(SCENES) $(RUNS),$(addprefix $(s).,$(STAGES) cfd))

help: ## this list
	@echo "make SCENE [LEVEL=..] [NP=..]  everything from kinematics to report.html"
	@echo "    SCENE: $(SCENES)"
	@echo "    LEVEL: smoke (2-D, seconds), coarse (default), medium, fine;  NP: MPI ranks, now $(NP)"
	@echo "make SCENE ACCURACY=12%        the cheapest measured setting within 12 %; BUDGET=10min: the most accurate within it"
	@echo "make SCENE NP=64 SLURM=1       as batch jobs [NODES=..] [MINUTES=..] [PARTITION=..] [ACCOUNT=..]; or HOSTS=hosts.txt; COLLATED=1: few files"
	@echo "make SCENE.STAGE               up to one stage: $(STAGES)"
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /make \1|/' | awk -F'|' '{printf "%-30s %s\n", $$1, $$2}'

setup: $(READY) ## Python environment and OpenFOAM, where missing
$(READY): requirements.lock pipeline/setup.sh
	@sh pipeline/setup.sh
	@touch $@

# One set of rules per scene. Every stage depends on the files of the stages before it and on its own settings, which are
# rewritten only when their content changes: touching one number redoes only what follows from it. Python files are no
# prerequisites: editing them does not solve again (make clean does).
# Every stage gives its files their names when they are whole: make need not, and after a kill or beside a second make must
# not, delete them.
define scene_rules
.PRECIOUS: $(addprefix $(2)/,kinematics.h5 planform.h5 sweep.h5 run/run.json sheet.h5 images.h5 piv.h5 vortices_cfd.csv vortices_piv.csv comparison.json report.html)
ifneq ($(ACCURACY)$(BUDGET),)
# the cheapest setting that was measured to reach it (docs/tradeoff.md), in a folder of its own
$(1): $(READY)
	@set -e; found=$$$$($(PY) -m pipeline.study.ask_accuracy cases/$(1) $(if $(ACCURACY),--accuracy "$(ACCURACY)",--budget "$(BUDGET)")); \
	set -- $$$$found; $$(MAKE) --no-print-directory CASES=cases/$(1)/out/studies/asked LEVEL=$$$$2 NP=$$$$3 ACCURACY= BUDGET= $$$$1$(if $(SLURM),,; \
	$(PY) -m pipeline.study.ask_accuracy cases/$(1) --after)
else ifneq ($(SLURM),)
$(1): $(READY)
	@$(PY) -m pipeline.study.slurm $(CASES)/$(1) --level $(LEVEL) $(if $(filter file,$(origin NP)),,--ranks $(NP)) --submit $(if $(MINUTES),--minutes $(MINUTES)) $(if $(NODES),--nodes $(NODES)) $(if $(PARTITION),--partition $(PARTITION)) $(if $(ACCOUNT),--account $(ACCOUNT)) $(if $(COLLATED),--collated) $(FLAGS)
else
$(1): $(1).report
	@echo "report: $$(abspath $(CASES)/$(1)/out/$(LEVEL)/report.html)"
endif
$(1).kinematics: $(2)/kinematics.h5
$(1).mesh: $(2)/planform.h5
$(1).case: $(2)/sweep.h5
$(1).run: $(2)/run/run.json
$(1).sheet: $(2)/sheet.h5
$(1).images: $(2)/images.h5
$(1).piv: $(2)/piv.h5
$(1).cfd: $(2)/vortices_cfd.csv
$(1).vortices: $(2)/vortices_cfd.csv $(2)/vortices_piv.csv
$(1).compare: $(2)/comparison.json
$(1).report: $(2)/report.html

$(2)/settings/.stamp: $(wildcard cases/*/scene.toml cases/*/*.csv cases/*/kinematics/* cases/_base cases/_base/* cases/_base/*/* $(CASES)/$(1)/scene.toml) | $(READY)
	@$(PY) -m pipeline.stage_settings $(CASES)/$(1) --level $(LEVEL) $(FLAGS)
$(2)/settings/%.json: $(2)/settings/.stamp
	@:
$(2)/kinematics.h5: $(2)/settings/kinematics.json
	$(PY) -m pipeline.kinematics.stage $(CASES)/$(1) --level $(LEVEL) $(FLAGS)
$(2)/planform.h5: $(2)/kinematics.h5 $(2)/settings/mesh.json
	$(PY) -m pipeline.mesh.stage $(CASES)/$(1) --level $(LEVEL) $(FLAGS)
$(2)/sweep.h5: $(2)/planform.h5 $(2)/settings/case.json
	$(PY) -m pipeline.case $(CASES)/$(1) --level $(LEVEL) $(FLAGS)
$(2)/run/run.json: $(2)/sweep.h5
	$(PY) -m pipeline.run.stage $(CASES)/$(1) --level $(LEVEL) --ranks $(NP) $(if $(HOSTS),--hosts $(HOSTS)) $(if $(COLLATED),--collated) $(FLAGS)
$(2)/sheet.h5: $(2)/run/run.json $(2)/settings/sheet.json
	$(PY) -m pipeline.sheet $(CASES)/$(1) --level $(LEVEL) $(FLAGS)
$(2)/images.h5: $(2)/sheet.h5 $(2)/settings/images.json
	$(PY) -m fileio.cost $(2)/costs/images.json -- $(PY) -m piv render $$< -o $$@ --settings $(2)/settings/images.json $(FLAGS)
$(2)/piv.h5: $(2)/images.h5 $(2)/settings/piv.json
	$(PY) -m fileio.cost $(2)/costs/piv.json -- $(PY) -m piv correlate $$< -o $$@ --threads $(JOBS) --settings $(2)/settings/piv.json $(FLAGS)
$(2)/vortices_cfd.csv: $(2)/sheet.h5 $(2)/settings/vortices.json
	$(PY) -m fileio.cost $(2)/costs/vortices_cfd.json -- $(PY) -m piv vortices $$< -o $$@ --threads $(JOBS) --settings $(2)/settings/vortices.json $(FLAGS)
$(2)/vortices_piv.csv: $(2)/piv.h5 $(2)/settings/vortices.json
	$(PY) -m fileio.cost $(2)/costs/vortices_piv.json -- $(PY) -m piv vortices $$< -o $$@ --threads $(JOBS) --settings $(2)/settings/vortices.json $(FLAGS)
$(2)/comparison.json: $(2)/vortices_cfd.csv $(2)/vortices_piv.csv $(wildcard $(CASES)/$(1)/reference/*) $(3)
	$(PY) -m postprocess.compare.stage $(CASES)/$(1) --level $(LEVEL) $(FLAGS)
$(2)/report.html: $(2)/comparison.json $(2)/settings/report.json
	$(PY) -m postprocess.report.figures $(CASES)/$(1) --level $(LEVEL) $(FLAGS)
	$(PY) -m postprocess.report.stage $(CASES)/$(1) --level $(LEVEL) $(FLAGS)
endef
# A pinch is compared with the single finger at the same level, where that was run; make single_finger first.
SINGLE := $(wildcard cases/single_finger/out/$(LEVEL)/vortices_*.csv)
$(foreach s,$(SCENES) $(RUNS),$(eval $(call scene_rules,$(s),$(CASES)/$(s)/out/$(LEVEL),$(if $(findstring pinch,$(s)),$(SINGLE)))))
# the files that each scene was made of when its settings were written, wherever they lie
include $(wildcard $(foreach s,$(SCENES) $(RUNS),$(CASES)/$(s)/out/$(LEVEL)/settings/.files.mk))

ifneq ($(SLURM),)
ifneq ($(filter $(foreach s,$(SCENES) $(RUNS),$(addprefix $(s).,$(STAGES) cfd)),$(MAKECMDGOALS)),)
$(error SLURM=1 goes with a whole scene, as make pinch SLURM=1, or with a study; single stages run on this machine, without it)
endif
endif

include postprocess/lab/compare.mk

fea: $(READY) ## bending analysis of the actuator of SCENE (single_finger): cases/SCENE/kinematics/states.h5
	$(PY) -m pipeline.fea cases/$(SCENE)

bench-piv: piv-limits ## PIV against its peers (own environment), and its limits; every table of docs/piv_benchmarks.md
	$(PY) -m tests.studies.piv.benchmark --docs

piv-limits: $(READY) ## PIV where it becomes worse, and on flows that served no tuning; tables into docs/piv_benchmarks.md
	$(PY) -m tests.studies.piv.limits --docs
	$(PY) -m tests.studies.piv.unseen --docs

faults: $(READY) ## kills, full disks, damaged files, two makes at once: docs/stability
	$(PY) -m tests.studies.faults
	$(PY) -m tests.studies.stability.page

fuzz: $(READY) ## damaged files for every reader, with atheris where it is installed: docs/stability
	$(PY) -m tests.studies.fuzz --table docs/stability/fuzz.csv
	$(PY) -m tests.studies.stability.page

# The level that each scene's page is made at. One after the other: each solver takes all ranks, and a pinch is compared with
# the single finger at its level.
DOCS ?= single_finger:coarse single_deflate:coarse cycle:coarse pinch:medium
docs: | $(READY) ## pages and pictures of the docs that come from runs (hours; one page: DOCS=pinch:medium)
	+set -e; for page in $(DOCS); do scene=$${page%:*}; level=$${page#*:}; run="$(MAKE) --no-print-directory LEVEL=$$level"; \
	case $$scene in *pinch*) $$run single_finger.vortices;; esac; \
	$$run $$scene.report; $(PY) -m postprocess.report.docs_page cases/$$scene --level $$level; done
	$(PY) -m tests.studies.pictures.vortices docs/vortices.png
	$(PY) -m tests.studies.pictures.synthetic docs/synthetic.png

# Studies: many runs by Snakemake, in an environment of its own; everything that computes stays in .venv.
STUDY_READY := .venv-study/.ready
SNAKEFLAGS  ?=
SNAKEMAKE    = .venv-study/bin/snakemake -s pipeline/study/Snakefile $(SNAKEFLAGS)
EXECUTOR    := $(if $(SLURM),--executor slurm -j100 --retries 3,-j$(JOBS))
empty :=
comma := ,
ONLY  = $(if $(STUDIES),only=$(subst $(empty) $(empty),$(comma),$(strip $(STUDIES))))

$(STUDY_READY): requirements-study.lock | $(READY)
	.venv/bin/python -m venv .venv-study
	.venv-study/bin/python -m pip install -q --disable-pip-version-check -r requirements-study.lock
	@touch $@

study: $(STUDY_READY) ## the runs of a table: make study STUDY=my_table.csv [SCENE=..] [STUDIES="some runs"] [SLURM=1]
	$(if $(STUDY),,$(error give the table: make study STUDY=cases/single_finger/studies/tradeoff.csv))
	+$(SNAKEMAKE) $(EXECUTOR) --config study=$(STUDY) $(ONLY) $(if $(filter command line,$(origin SCENE)),scene=cases/$(SCENE))

tradeoff: $(STUDY_READY) ## what accuracy costs: the study of SCENE (single_finger), docs/tradeoff.md and docs/tradeoff/
	+$(SNAKEMAKE) $(EXECUTOR) --config study=cases/$(SCENE)/studies/tradeoff.csv
	$(PY) -m postprocess.studies.tradeoff cases/$(SCENE)/out/studies/tradeoff/plan.json

fea-studies: $(STUDY_READY) ## studies over wedge, width and materials: cases/single_finger/kinematics/studies
	+$(SNAKEMAKE) $(EXECUTOR) --config study=cases/single_finger/studies/bending.csv
	$(PY) -m pipeline.fea.studies.studies

pinch-studies: $(STUDY_READY) ## studies of the pinch (STUDIES="gap1 gap2": only some): docs/pinch_studies.md
	+$(SNAKEMAKE) $(EXECUTOR) --config study=cases/pinch/studies/variations.csv $(ONLY); made=$$?; \
	$(PY) -m postprocess.studies.judge cases/pinch/out/studies/variations/plan.json --words cases/pinch/studies/variations.md -o docs/pinch_studies \
	&& exit $$made # a run that was stopped is named on the page, and in the exit code

bench-steps: $(READY) ## a time step on moving and static mesh, 1 and 2 ranks, with and without samples: docs/tradeoff/steps.csv
	$(PY) -m tests.studies.step_cost --level $(LEVEL)

validate: $(STUDY_READY) ## flows of known answer through the project's own stages: docs/verification.md
	+$(SNAKEMAKE) $(EXECUTOR) --config study=cases/validation/studies/validation.csv
	+$(SNAKEMAKE) $(EXECUTOR) --config study=cases/validation/studies/convergence.csv
	nice $(PY) -m tests.studies.validation $(FLAGS)

convergence: $(STUDY_READY) ## the finger on several grids and time steps: rows of docs/verification.md
	+$(SNAKEMAKE) $(EXECUTOR) --config study=cases/validation/studies/convergence.csv
	nice $(PY) -m tests.studies.validation finger_2d finger $(FLAGS)

stability: $(STUDY_READY) ## runs and images at the extremes: docs/stability.md
	+$(SNAKEMAKE) $(EXECUTOR) --config study=cases/single_finger/studies/stability.csv
	+$(SNAKEMAKE) $(EXECUTOR) --config study=cases/pinch/studies/stability.csv
	$(PY) -m tests.studies.stability

predict: cases/$(SCENE)/out/$(LEVEL)/sweep.h5 ## hours of SCENE at LEVEL on 1 to 256 ranks, and how many ranks pay
	@$(PY) -m pipeline.study.predict cases/$(SCENE) --level $(LEVEL)

test-slurm: $(STUDY_READY) ## a real Slurm of one node, started and stopped by the test (slurm-wlm, root); log in docs/cluster.md
	$(PY) -m pytest tests/slurm -p no:cacheprovider -s

lint: $(READY) ## ruff, mypy and the import rules
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy
	.venv/bin/lint-imports

test: lint ## the whole test suite
	$(PY) -m pytest -n $(NP)

unit: $(READY) ## the tests that need no OpenFOAM
	$(PY) -m pytest tests/unit tests/analytic tests/golden

clean: ## everything generated by runs (all scenes and levels)
	rm -rf cases/*/out cases/*/*/out

clean-all: clean ## that, and the Python environment
	rm -rf .venv .venv-study
