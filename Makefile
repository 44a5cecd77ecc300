# Soft finger in water: from kinematics to the report. `make help` lists what there is.
LEVEL ?= coarse
NP    ?= $(shell n=$$(nproc 2>/dev/null || echo 1); [ $$n -gt 4 ] && n=4; echo $$n)
HOSTS ?=
QUIET ?=

# The sheet's vortices are found while its images are still rendered.
MAKEFLAGS += -j$(NP)

SHELL  := /bin/sh
PY     := .venv/bin/python
SCENES := $(patsubst cases/%/scene.toml,%,$(wildcard cases/*/scene.toml))
STAGES := kinematics mesh case run sheet images piv vortices compare report
READY  := .venv/.ready
FLAGS  := $(if $(QUIET),--quiet)

.SUFFIXES:
.SECONDARY:
.PHONY: help setup test lint unit fea fea-studies pinch-studies docs clean clean-all bench-piv stability faults fuzz $(SCENES) $(foreach s,$(SCENES),$(addprefix $(s).,$(STAGES) cfd))

help: ## this list
	@echo "make setup                     Python environment and OpenFOAM, where missing"
	@echo "make SCENE [LEVEL=..] [NP=..]  everything from kinematics to report.html"
	@echo "    SCENE: $(SCENES)"
	@echo "    LEVEL: smoke (2-D, seconds), coarse (default), medium, fine;  NP: MPI ranks, now $(NP)"
	@echo "make SCENE.STAGE               up to one stage: $(STAGES)"
	@grep -E '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /make \1|/' | awk -F'|' '{printf "%-30s %s\n", $$1, $$2}'

setup: $(READY) ## only the set-up
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
$(1): $(1).report
	@echo "report: $$(abspath cases/$(1)/out/$(LEVEL)/report.html)"
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

$(2)/settings/.stamp: $(wildcard cases/*/scene.toml cases/*/*.csv cases/*/kinematics/*) | $(READY)
	@$(PY) -m pipeline.settings cases/$(1) --level $(LEVEL) $(FLAGS)
$(2)/settings/%.json: $(2)/settings/.stamp
	@:
$(2)/kinematics.h5: $(2)/settings/kinematics.json
	$(PY) -m pipeline.kinematics cases/$(1) --level $(LEVEL) $(FLAGS)
$(2)/planform.h5: $(2)/kinematics.h5 $(2)/settings/mesh.json
	$(PY) -m pipeline.mesh cases/$(1) --level $(LEVEL) $(FLAGS)
$(2)/sweep.h5: $(2)/planform.h5 $(2)/settings/case.json
	$(PY) -m pipeline.case cases/$(1) --level $(LEVEL) $(FLAGS)
$(2)/run/run.json: $(2)/sweep.h5
	$(PY) -m pipeline.run cases/$(1) --level $(LEVEL) --ranks $(NP) $(if $(HOSTS),--hosts $(HOSTS)) $(FLAGS)
$(2)/sheet.h5: $(2)/run/run.json $(2)/settings/sheet.json
	$(PY) -m pipeline.sheets cases/$(1) --level $(LEVEL) $(FLAGS)
$(2)/images.h5: $(2)/sheet.h5 $(2)/settings/images.json
	$(PY) -m piv render $$< -o $$@ --settings $(2)/settings/images.json $(FLAGS)
$(2)/piv.h5: $(2)/images.h5 $(2)/settings/piv.json
	$(PY) -m piv correlate $$< -o $$@ --threads $(NP) --settings $(2)/settings/piv.json $(FLAGS)
$(2)/vortices_cfd.csv: $(2)/sheet.h5 $(2)/settings/vortices.json
	$(PY) -m piv vortices $$< -o $$@ --threads $(NP) --settings $(2)/settings/vortices.json $(FLAGS)
$(2)/vortices_piv.csv: $(2)/piv.h5 $(2)/settings/vortices.json
	$(PY) -m piv vortices $$< -o $$@ --threads $(NP) --settings $(2)/settings/vortices.json $(FLAGS)
$(2)/comparison.json: $(2)/vortices_cfd.csv $(2)/vortices_piv.csv $(wildcard cases/$(1)/reference/*) $(3)
	$(PY) -m postprocess.compare cases/$(1) --level $(LEVEL) $(FLAGS)
$(2)/report.html: $(2)/comparison.json $(2)/settings/report.json
	$(PY) -m postprocess.figures cases/$(1) --level $(LEVEL) $(FLAGS)
	$(PY) -m postprocess.report cases/$(1) --level $(LEVEL) $(FLAGS)
endef
# A pinch is compared with the single finger at the same level, where that was run; make single_finger first.
SINGLE := $(wildcard cases/single_finger/out/$(LEVEL)/vortices_*.csv)
$(foreach s,$(SCENES),$(eval $(call scene_rules,$(s),cases/$(s)/out/$(LEVEL),$(if $(findstring pinch,$(s)),$(SINGLE)))))

fea: $(READY) ## bending analysis of the default actuator: cases/single_finger/kinematics/states.h5
	$(PY) -m pipeline.fea cases/single_finger

bench-piv: $(READY) ## PIV against its peers (own environment); table into docs/piv.md
	$(PY) tests/benchmarks/piv_bench.py --docs

stability: $(READY) ## runs and images at the extremes: docs/stability.md
	$(PY) -m tests.stability

faults: $(READY) ## kills, full disks, damaged files, two makes at once: docs/stability
	$(PY) -m tests.faults
	$(PY) -m tests.stability.page

fuzz: $(READY) ## damaged files for every reader, with atheris where it is installed: docs/stability
	$(PY) -m tests.fuzz --table docs/stability/fuzz.csv
	$(PY) -m tests.stability.page

docs: single_finger.report single_deflate.report ## pages and pictures of the docs that come from runs
	$(PY) -m postprocess.summary cases/single_finger --level $(LEVEL)
	$(PY) -m postprocess.summary cases/single_deflate --level $(LEVEL)
	$(PY) -m tests.pictures.vortices docs/vortices.png
	$(PY) -m tests.pictures.synthetic docs/synthetic.png

STUDIES ?= smoke coarse $(shell sed -n 's/^\[levels\.\([a-z0-9_]*\)\].*/\1/p' cases/pinch_studies/scene.toml)
pinch-studies: $(READY) ## studies of the pinch (STUDIES="gap1 gap2": only some): docs/pinch_studies.md
	@for level in $(STUDIES); do $(MAKE) --no-print-directory pinch_studies.cfd LEVEL=$$level || exit 1; done
	$(PY) -m postprocess.studies cases/pinch_studies

fea-studies: $(READY) ## studies over wedge, width and materials: docs/fea
	$(PY) -m pipeline.fea.studies

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
	rm -rf .venv
