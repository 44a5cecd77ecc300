# Soft finger in water: from kinematics to the report. `make help` lists what there is.

# What is given reaches a shell and make's own rules: letters that these would read as more than a name are refused.
GIVEN  := LEVEL NP HOSTS COLLATED QUIET CASES SLURM ACCURACY BUDGET SCENE STUDY STUDIES NODES MINUTES PARTITION \
    COUPLED WHOLE ACCOUNT RETRIES DOCS DPIV INPUTS QUICK PRESSURE SNAKEFLAGS OTHER WM_PROJECT_DIR CURDIR MAKECMDGOALS
HASH   := \#
UNSAFE := ' " ` \ ; & | < > * ? ! ~ { } ( ) [ ] $$ $(HASH)
NAMED.CURDIR := this folder's path
NAMED.MAKECMDGOALS := the target
$(foreach v,$(GIVEN),$(foreach c,$(UNSAFE),$(if $(findstring $c,$(value $v)),$(error \
    $(or $(NAMED.$v),$v) has the letter $c in it, which a shell reads otherwise; \
    $(if $(filter CURDIR,$v),move the project to a path,give it) without))))
$(if $(word 2,$(CURDIR)),$(error this folder's path has a space in it; move the project to a path without))
# of at most six digits: more are too long for a shell's arithmetic
NUMBER  = $(shell echo '$($1)' | grep -xE '0*$2[0-9]{0,5}')
$(foreach v,NP NODES MINUTES,$(if $($v),$(if $(call NUMBER,$v,[1-9]),,$(error \
    $v=$($v): give a whole number of 1 to 999999))))
$(if $(RETRIES),$(if $(call NUMBER,RETRIES,[0-9]),,$(error RETRIES=$(RETRIES): give a whole number of 0 to 999999)))
# 0 would switch on as well
$(foreach v,SLURM COUPLED COLLATED QUIET WHOLE QUICK,$(if $(filter-out 1,$($v)),$(error \
    $v=$($v): give 1, or leave it out)))

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
COUPLED ?=
BUDGET ?=
WHOLE ?=

# The sheet's vortices are found while its images are still rendered.
ifeq ($(MAKELEVEL),0) # a make within make shares the jobs of the first
MAKEFLAGS += -j$(JOBS)
endif

SHELL  := /bin/sh
PY     := .venv/bin/python
SCENE  ?= single_finger
READY  := .venv/.ready
FLAGS  := $(if $(QUIET),--quiet)

include fileio/stages.mk
include postprocess/lab/compare.mk

USER_TARGETS := help setup study tradeoff predict test-slurm test lint unit fea fea-studies pinch-studies docs compare \
    compare-measured compare-coupled virtual-lab virtual-lab-study validate convergence distribution planforms \
    pinch-jet clean clean-all bench-piv piv-limits bench-steps air-and-water closing-plates elastic-benchmarks \
    coupled-docs compare-coupled-study stability faults fuzz scene-reference docs-site openfoam-versions
INNER_TARGETS := lab-register lab-motion lab-compare lab-sheets study-sheets

# Files of a pattern whose names make and a shell read as they are; a scene's name is no target's either.
SAFE    = $(shell sh pipeline/names.sh files $(foreach f,$(1),'$(f)'))
SCENES := $(shell sh pipeline/names.sh scenes $(CASES) $(USER_TARGETS) $(INNER_TARGETS))
# scenes that a comparison with a laboratory made: runs beside the nominal one
MEASURED := lab/*/measured lab/*/measured/out/*/inputs/*
MADE   := inputs/* virtual/* $(MEASURED) lab/*/modelled $(addprefix lab/*/modelled/out/*/,$(MEASURED))
MADE   := $(addprefix /out/*/,$(MADE))
MADE   := $(foreach s,$(SCENES),$(patsubst %,$(CASES)/$s%/scene.toml,$(MADE)))
RUNS   := $(patsubst $(CASES)/%/scene.toml,%,$(call SAFE,$(MADE)))
ALL    := $(SCENES) $(RUNS)
OF_SCENES := $(ALL) $(foreach s,$(ALL),$(addprefix $(s).,$(STAGES) $(TARGETS) view))
# A target that is none is told with the nearest that is one; files by their path are left to make.
NEAREST = $(shell $(PY) -c 'import sys; from fileio.errors import nearest; print(nearest(sys.argv[1], sys.argv[2:]) \
    or "")' '$1' $2 2>/dev/null)
MEANT   = $(if $(call NEAREST,$1,$2),did you mean $(call NEAREST,$1,$2)? )make help lists what there is
KNOWN  := $(USER_TARGETS) $(OF_SCENES) $(INNER_TARGETS) $(READY) Makefile
$(foreach g,$(MAKECMDGOALS),$(if $(or $(findstring /,$g),$(filter $g,$(KNOWN))),,$(error \
    $g: no such scene or target; $(call MEANT,$g,$(KNOWN)))))
$(if $(filter $(SCENE),$(ALL)),,$(if $(filter file undefined,$(origin SCENE)),,$(error \
    SCENE=$(SCENE): no such scene; $(call MEANT,$(SCENE),$(ALL)))))
# So is a switch of make's command line.
SWITCHES := $(filter-out CURDIR MAKECMDGOALS,$(GIVEN)) PLATE_LEVELS BENCH_VENV SHARED_DATA PYTHON READY SHELL MAKEFLAGS
$(foreach v,$(.VARIABLES),$(if $(filter command,$(origin $v)),$(if $(filter $v,$(SWITCHES)),,$(error \
    $v: no such switch; $(call MEANT,$v,$(SWITCHES))))))
# An OpenFOAM that is asked for is tried before anything is computed.
WITHOUT := help setup lint unit fea fea-studies scene-reference docs-site clean clean-all
NEEDED  := $(and $(filter 0,$(MAKELEVEL)),$(wildcard $(PY)),$(filter-out $(WITHOUT),$(MAKECMDGOALS)))
ifneq ($(and $(WM_PROJECT_DIR),$(NEEDED)),)
NO_OPENFOAM := $(shell said=$$(WM_PROJECT_DIR='$(WM_PROJECT_DIR)' $(PY) -m pipeline openfoam 2>&1) || echo "$$said")
$(if $(NO_OPENFOAM),$(error $(NO_OPENFOAM)))
endif
.SUFFIXES:
# Where one of the large files was deleted, what was made of it stands; a small one is made again.
LARGE := kinematics mesh case run sheet images piv
.SECONDARY: $(foreach s,$(ALL),$(foreach t,$(LARGE),$(CASES)/$s/out/$(LEVEL)/$(FILE.$t)))
.DEFAULT_GOAL := help
.PHONY: $(USER_TARGETS) $(OF_SCENES) $(INNER_TARGETS)

help: ## this list
	@echo "make SCENE [LEVEL=..] [NP=..]  everything from kinematics to report.html"
	@echo "    SCENE: $(SCENES)"
	@echo "    LEVEL: smoke (2-D, 1 minute), draft (3), coarse (default, 6), medium (14), fine (half an hour"
	@echo "    and more: make predict), reference (the finest: hours); a pinch takes several times as long"
	@echo "    NP: MPI ranks, now $(NP); HOSTS=hosts.txt: on those machines; COLLATED=1: few files"
	@echo "make SCENE ACCURACY=12%        the cheapest measured setting within 12 %;"
	@echo "make SCENE BUDGET=10min        the most accurate within the time"
	@echo "make SCENE COUPLED=1           the motion that pressure and water make together, by three or four whole runs"
	@echo "make SCENE NP=64 SLURM=1       as batch jobs [NODES=..] [MINUTES=..] [PARTITION=..] [ACCOUNT=..]"
	@echo "make SCENE.STAGE               up to one stage:"
	@$(foreach s,$(STAGES),printf '    %-14s %s\n' $(s) "$(ABOUT.$(s))";)
	@echo "make SCENE.view [WHOLE=1]      the run in ParaView, as a time series; WHOLE=1: the whole tank"
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /make \1|/' \
	    | awk -F'|' '{printf "%-30s %s\n", $$1, $$2}'

setup: $(READY) ## Python environment and OpenFOAM, where missing
$(READY): requirements.lock pipeline/setup.sh pipeline/command.sh
	@sh pipeline/setup.sh
	@touch $@

# Rules of a scene $(1), whose results lie in $(2), and of its stage $(3). A stage depends on the files of the stages
# before it and on its own settings, which are rewritten only when their content changes: touching one number redoes
# only what follows from it. Python files are no prerequisites: editing them does not solve again (make clean does).
# A stage gives its files their names when they are whole: make must not delete them, not even after a kill.
RANKS   = --ranks $(NP) $(if $(HOSTS),--hosts $(HOSTS)) $(if $(COLLATED),--collated)
THREADS = --threads $(JOBS)
# what a scene may be made of, before its settings say so
INHERITED := $(call SAFE,$(addprefix cases/,*/scene.toml */*.csv */kinematics/* _base _base/* _base/*/*))
INHERITED += $(wildcard fileio/formats/*.py) # their versions
define scene_rules
.PRECIOUS: $(foreach s,$(STAGES),$(2)/$(FILE.$(s)))
$(2)/settings/.stamp: $(INHERITED) $(CASES)/$(1)/scene.toml | $(READY)
	@$(PY) -m pipeline settings $(CASES)/$(1) --level $(LEVEL) $(FLAGS)
# one rule for each: of a rule for both, make takes the other file for made anew
$(2)/settings/%.json: $(2)/settings/.stamp
	@[ -e $$@ ] || $(PY) -m pipeline settings $(CASES)/$(1) --level $(LEVEL) $(FLAGS)
$(2)/settings/%.format: $(2)/settings/.stamp
	@[ -e $$@ ] || $(PY) -m pipeline settings $(CASES)/$(1) --level $(LEVEL) $(FLAGS)
$(2)/$(FILE.compare): $(call SAFE,$(CASES)/$(1)/reference/*)
$(foreach g,$(GROUPS),$(1).$(g): $(addprefix $(1).,$(OF.$(g))))
$(1).view: $(2)/view$(if $(WHOLE),_whole)/water.pvd
$(2)/view/water.pvd $(2)/view_whole/water.pvd: $(2)/run/run.json
	$(PY) -m pipeline view $(CASES)/$(1) --level $(LEVEL) $(if $(WHOLE),--whole) $(FLAGS)
endef
define stage_rules
$(1).$(3): $(2)/$(FILE.$(3))
$(2)/$(FILE.$(3)): $(addprefix $(2)/,$(NEEDS.$(3)))
	$(PY) -m pipeline $(3) $(CASES)/$(1) --level $(LEVEL) $(OPTIONS.$(3)) $(FLAGS)
endef
$(foreach s,$(ALL),$(eval $(call scene_rules,$(s),$(CASES)/$(s)/out/$(LEVEL))))
$(foreach s,$(ALL),$(foreach t,$(STAGES),$(eval $(call stage_rules,$(s),$(CASES)/$(s)/out/$(LEVEL),$(t)))))
# what each scene was made of when its settings were written, wherever it lies, and what it is compared with
include $(wildcard $(foreach s,$(ALL),$(CASES)/$(s)/out/$(LEVEL)/settings/.files.mk))

# Studies: many runs by Snakemake, in an environment of its own; everything that computes stays in .venv.
# By Slurm: a job that is cut off at its time limit is submitted again for twice the time (for MINUTES again, where they
# are given), at most RETRIES times, and its solver goes on from its last checkpoint.
STUDY_READY := .venv-study/.ready
SNAKEFLAGS  ?=
SNAKEMAKE    = .venv-study/bin/snakemake -s pipeline/study/Snakefile $(SNAKEFLAGS)
RETRIES     ?= 5
PLACE       := $(if $(PARTITION),slurm_partition=$(PARTITION)) $(if $(ACCOUNT),slurm_account=$(ACCOUNT))
OF_RUN      := $(if $(NODES),run:nodes=$(NODES)) $(if $(MINUTES),run:runtime=$(MINUTES))
IN_SLURM    := $(if $(strip $(PLACE)),--default-resources $(PLACE)) $(if $(strip $(OF_RUN)),--set-resources $(OF_RUN))
EXECUTOR    := $(if $(SLURM),--executor slurm --slurm-requeue -j100 --retries $(RETRIES) $(IN_SLURM),-j$(JOBS))
empty :=
comma := ,
ONLY  = $(if $(STUDIES),only=$(subst $(empty) $(empty),$(comma),$(strip $(STUDIES))))

# A whole scene: at once, at the cheapest setting that was measured to be as accurate (docs/tradeoff.md), coupled
# (docs/coupling.md), or by Slurm.
ifneq ($(ACCURACY)$(BUDGET),)
ASKED = cases/$@ $(if $(ACCURACY),--accuracy="$(ACCURACY)",--budget="$(BUDGET)")
$(ALL): $(READY)
	+@set -e; found=$$($(PY) -m pipeline choose $(ASKED)); set -- $$found; \
	$(MAKE) --no-print-directory CASES=cases/$@/out/studies/asked LEVEL=$$2 NP=$$3 ACCURACY= BUDGET= $$1; \
	$(PY) -m pipeline choose cases/$@ --after
else ifneq ($(COUPLED),)
$(ALL): $(READY)
	$(PY) -m pipeline couple $(CASES)/$@ --level $(LEVEL) --ranks $(NP) $(FLAGS)
else ifneq ($(SLURM),)
$(ALL): $(STUDY_READY)
	+$(SNAKEMAKE) $(EXECUTOR) --config run=$(CASES)/$@ level=$(LEVEL) ranks=$(NP)
else
$(ALL): %: %.report
	@echo "report: $(abspath $(CASES)/$*/out/$(LEVEL)/report.html)"
endif
ifneq ($(SLURM)$(COUPLED),)
ifneq ($(filter $(filter-out $(ALL),$(OF_SCENES)),$(MAKECMDGOALS)),)
$(error \
    $(if $(COUPLED),COUPLED=1 goes with a whole scene,SLURM=1 goes with a whole scene or a study), not with one stage)
endif
endif
ifneq ($(and $(COUPLED),$(strip $(SLURM)$(ACCURACY)$(BUDGET)$(HOSTS)$(COLLATED))),)
$(error COUPLED=1 takes LEVEL, NP and QUIET alone)
endif

fea: $(READY) ## bending analysis of the actuator of SCENE (single_finger): cases/SCENE/kinematics/states.h5
	$(PY) -m pipeline fea cases/$(SCENE) --level $(LEVEL) $(FLAGS)

bench-piv: piv-limits ## PIV against its peers, and its limits: docs/piv_benchmarks.md; a stopped run goes on
	$(PY) -m tests.studies.piv.benchmark --docs --folder .venv-bench/benchmark
	$(PY) -m tests.studies.piv.turbulence --docs --folder .venv-bench/turbulence
	$(PY) -m tests.studies.piv.public_data --docs --folder .venv-bench/public
	$(PY) -m tests.studies.piv.costs --docs

piv-limits: $(READY) ## PIV where it becomes worse, and on flows that served no tuning: docs/piv_benchmarks.md
	$(PY) -m tests.studies.piv.limits --docs
	$(PY) -m tests.studies.piv.unseen --docs

faults: $(READY) ## kills, full disks, damaged files, two makes at once: docs/stability
	$(PY) -m tests.studies.faults
	+$(MAKE) --no-print-directory LEVEL=smoke single_finger.report
	$(PY) -m tests.studies.faults.damaged cases/single_finger --level smoke --table docs/stability/damaged.csv
	$(PY) -m tests.studies.stability.page

fuzz: $(READY) ## damaged files for every reader, with atheris where it is installed: docs/stability
	$(PY) -m tests.studies.fuzz --table docs/stability/fuzz.csv
	$(PY) -m tests.studies.fuzz.scenes --table docs/stability/scenes.csv
	$(PY) -m tests.studies.stability.page

scene-reference: $(READY) ## every key of scene.toml and dpiv.toml, in docs/ (--template: a file to start from)
	$(PY) -m pipeline scene-reference
	$(PY) -m postprocess dpiv-reference

# scene:level of each page, and the scene it is compared with, run first. One after the other: each takes all ranks.
DOCS ?= single_finger:coarse single_deflate:coarse cycle:coarse pinch:coarse:single_finger pinch:medium:single_finger
docs: | $(READY) ## pages and pictures of the docs that come from runs (hours; one page: DOCS=cycle:coarse)
	+set -e; IFS=:; for page in $(DOCS); do set -- $$page; run() { $(MAKE) --no-print-directory LEVEL=$$2 $$1; }; \
	[ -z "$$3" ] || run $$3.vortices $$2; run $$1.report $$2; $(PY) -m postprocess docs-page cases/$$1 --level $$2; done
	$(PY) -m tests.studies.pictures.vortices docs/vortices.png
	$(PY) -m tests.studies.pictures.synthetic docs/synthetic.png

DOCS_READY := .venv-docs/.ready
docs-site: $(DOCS_READY) ## these pages and the API as a site that needs no network: site/index.html (a minute)
	nice .venv-docs/bin/sphinx-build -q -W --keep-going -d .sphinx docs site
	@echo "site: $(CURDIR)/site/index.html"

$(DOCS_READY): requirements-docs.lock | $(READY)
	.venv/bin/python -m venv .venv-docs
	.venv-docs/bin/python -m pip install -q --disable-pip-version-check --require-hashes -r requirements-docs.lock
	@touch $@

$(STUDY_READY): requirements-study.lock | $(READY)
	.venv/bin/python -m venv .venv-study
	.venv-study/bin/python -m pip install -q --disable-pip-version-check --require-hashes -r requirements-study.lock
	@touch $@

ifneq ($(filter study,$(MAKECMDGOALS)),)
$(if $(wildcard $(STUDY)),,$(error \
    STUDY=$(STUDY): no such file; give a table: make study STUDY=cases/single_finger/studies/tradeoff.csv))
endif
study: $(STUDY_READY) ## the runs of a table: make study STUDY=my_table.csv [SCENE=..] [STUDIES="some runs"] [SLURM=1]
	+$(SNAKEMAKE) $(EXECUTOR) --config study=$(STUDY) $(ONLY) \
	    $(if $(filter command line,$(origin SCENE)),scene=cases/$(SCENE))

tradeoff: $(STUDY_READY) ## what accuracy costs: the study of SCENE (single_finger), docs/tradeoff.md and docs/tradeoff/
	+$(SNAKEMAKE) $(EXECUTOR) --config study=cases/$(SCENE)/studies/tradeoff.csv
	$(PY) -m postprocess tradeoff cases/$(SCENE)/out/studies/tradeoff/plan.json

fea-studies: $(STUDY_READY) ## studies over wedge, width and materials: cases/single_finger/kinematics/studies
	+$(SNAKEMAKE) $(EXECUTOR) --config study=cases/single_finger/studies/bending.csv
	$(PY) -m pipeline fea-studies

VARIED := cases/pinch/out/studies/variations/plan.json
pinch-studies: $(STUDY_READY) ## studies of the pinch (STUDIES="gap1 gap2": only some): docs/pinch_studies.md
	+$(SNAKEMAKE) $(EXECUTOR) --config study=cases/pinch/studies/variations.csv $(ONLY); made=$$?; \
	$(PY) -m postprocess judge $(VARIED) --words cases/pinch/studies/variations.md -o docs/pinch_studies \
	&& exit $$made # a run that was stopped is named on the page, and in the exit code

PLATE_LEVELS := smoke draft
closing-plates: | $(READY) ## the pinch beside closing plates, in two and three dimensions: docs/pinch_plates.md
	+set -e; for level in $(PLATE_LEVELS); do $(MAKE) --no-print-directory LEVEL=$$level pinch.vortices_cfd; done
	$(PY) -m tests.studies.closing_plates --levels $(PLATE_LEVELS)

air-and-water: $(READY) ## radius and actuation time in air and water, and what decides them: docs/coupling.md
	$(PY) -m tests.studies.air_and_water

elastic-benchmarks: $(READY) ## the elastic chain against published numbers of other bodies: docs/coupling.md
	$(PY) -m tests.studies.elastic_benchmarks

coupled-docs: $(READY) ## coupled runs beside prescribed ones: tables of docs/coupling.md
	$(PY) -m tests.studies.coupled_runs --level $(LEVEL)

compare-coupled-study: $(READY) ## recordings of coupled fingers, causes told right or wrong: docs/comparison.md
	$(PY) -m tests.studies.laboratory.causes

openfoam-versions: $(READY) ## the single finger by another OpenFOAM, beside this one: OTHER=/its/folder
	$(PY) -m tests.studies.openfoam_versions $(OTHER) --level $(LEVEL)

bench-steps: $(READY) ## a time step on moving and static mesh, 1 and 2 ranks: pipeline/study/steps.csv
	$(PY) -m tests.studies.step_cost --level $(LEVEL)

validate: $(STUDY_READY) ## flows of known answer through the project's own stages: docs/verification.md
	+$(SNAKEMAKE) $(EXECUTOR) --config study=cases/validation/studies/validation.csv
	+$(SNAKEMAKE) $(EXECUTOR) --config study=cases/validation/studies/convergence.csv
	nice $(PY) -m tests.studies.validation $(FLAGS)

# the family of grids, and a whole stroke, whose bend gives the window in which they are compared
FAMILY := grid_draft,grid_coarse,grid_medium,grid_fine,grid_reference,draft
convergence: $(STUDY_READY) ## the finger on several grids and time steps: rows of docs/verification.md, docs/mesh.md
	+$(SNAKEMAKE) $(EXECUTOR) --config study=cases/validation/studies/convergence.csv
	+$(SNAKEMAKE) $(EXECUTOR) --config study=cases/single_finger/studies/tradeoff.csv only=$(FAMILY)
	nice $(PY) -m tests.studies.validation finger_2d finger $(FLAGS)
	nice $(PY) -m tests.studies.circulation

DISTRIBUTION := cases/single_finger/studies/distribution.csv
distribution: $(STUDY_READY) ## what decides the error at the cost of coarse: docs/mesh.md
	+$(SNAKEMAKE) $(EXECUTOR) --config study=cases/single_finger/studies/tradeoff.csv only=$(FAMILY)
	+$(SNAKEMAKE) $(EXECUTOR) --config study=$(DISTRIBUTION) $(ONLY)
	nice $(PY) -m tests.studies.distribution

planforms: $(STUDY_READY) ## planforms of motions that are hard to follow: docs/mesh.md
	+$(SNAKEMAKE) $(EXECUTOR) --config study=cases/pinch/studies/planforms.csv
	nice $(PY) -m tests.studies.planforms

pinch-jet: $(STUDY_READY) ## what of the pinch's jet depends on the grid: docs/mesh.md
	+$(SNAKEMAKE) $(EXECUTOR) --config study=cases/pinch/studies/jet.csv $(ONLY)
	nice $(PY) -m tests.studies.pinch_jet

stability: $(STUDY_READY) ## runs and images at the extremes: docs/stability.md
	+$(SNAKEMAKE) $(EXECUTOR) --config study=cases/single_finger/studies/stability.csv
	+$(SNAKEMAKE) $(EXECUTOR) --config study=cases/pinch/studies/stability.csv
	$(PY) -m tests.studies.stability

predict: cases/$(SCENE)/out/$(LEVEL)/$(FILE.case) ## time of SCENE at LEVEL on 1 to 256 ranks, and how many ranks pay
	@$(PY) -m pipeline predict cases/$(SCENE) --level $(LEVEL)

test-slurm: $(STUDY_READY) ## a real Slurm of one node, started and stopped by the test (slurm-wlm, root)
	$(PY) -m pytest tests/slurm -p no:cacheprovider -s

lint: $(READY) ## ruff, mypy and the import rules
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy
	.venv/bin/lint-imports

test: lint ## the whole test suite
	$(PY) -m pytest -n $(NP) --dist worksteal

unit: $(READY) ## the tests that need no OpenFOAM
	$(PY) -m pytest tests/unit tests/analytic tests/golden

clean: ## everything generated by runs (all scenes and levels)
	rm -rf cases/*/out cases/*/*/out site .sphinx docs/api

clean-all: clean ## that, and the Python environments
	rm -rf .venv .venv-study .venv-docs .venv-bench
