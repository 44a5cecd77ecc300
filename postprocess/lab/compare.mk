# Comparison with a laboratory (docs/comparison.md). Its runs beside the nominal one are scenes of their own, written
# when it is known what they are: each step is a make of its own. INPUTS= (empty) leaves those runs out.
# Registration comes first: it asks for what dpiv.toml leaves out before anything is solved.
INPUTS ?= yes
QUICK  ?=
SUB     = $(MAKE) --no-print-directory LEVEL=$(LEVEL) NP=$(NP) QUIET=$(QUIET)
CASE    = $(CASES)/$(SCENE)
LABOUT  = $(CASE)/out/$(LEVEL)
LABDATA = $(patsubst %/,%,$(patsubst %/dpiv.toml,%,$(DPIV)))
LABNAME = $(notdir $(realpath $(LABDATA)))
LAB     = $(PY) -m postprocess.lab
LABHERE = $(LABOUT)/lab/$(LABNAME)
# a sheet over another view than the camera's: of the scene $(1), x0 x1 y0 y1 (m)
VIEW    = $(PY) -m pipeline sheet $(1) --level $(LEVEL) --view $(2) -o $@ $(FLAGS)
OFLAB   = $(CASE) --level $(LEVEL) --dpiv $(DPIV) $(FLAGS)
PREDICT = $(PY) -m pipeline predict $(CASE) --level $(LEVEL) --seconds
PLAN    = seconds=$$($(PREDICT)) && $(LAB) plan $(CASE) --level $(LEVEL) --ranks $(NP) --solver $$seconds $(FLAGS)

ifneq ($(filter compare compare-measured compare-coupled,$(MAKECMDGOALS)),)
$(if $(filter 1,$(words $(DPIV))),,$(error give DPIV=folder of dpiv.toml, a path without spaces: docs/comparison.md))
$(if $(wildcard $(LABDATA)/dpiv.toml),,$(error DPIV=$(DPIV): holds no dpiv.toml; docs/comparison.md shows one))
$(if $(QUICK),$(if $(filter compare-measured compare-coupled,$(MAKECMDGOALS)),$(error \
    QUICK=$(QUICK) goes with compare; leave it out)))
endif
compare: | $(READY) ## SCENE against laboratory data: make compare SCENE=.. DPIV=folder [QUICK=1: motion alone]
	$(if $(QUICK),+@$(SUB) $(SCENE).kinematics,+@$(SUB) SCENE=$(SCENE) DPIV=$(DPIV) lab-register)
	$(if $(QUICK),,$(if $(INPUTS),+@$(SUB) $(SCENE).case))
	$(if $(QUICK),@$(LAB) register $(OFLAB) --quick,$(if $(INPUTS),@$(PLAN)))
	$(if $(QUICK),,+@$(SUB) SCENE=$(SCENE) DPIV=$(DPIV) INPUTS=$(INPUTS) lab-compare)
lab-compare:
	+@$(SUB) $(SCENE).run
	$(if $(INPUTS),@$(LAB) runs $(CASE) --level $(LEVEL) $(FLAGS),@rm -rf $(LABHERE)/inputs)
	+@$(SUB) SCENE=$(SCENE) DPIV=$(DPIV) INPUTS=$(INPUTS) lab-sheets
	$(LAB) compare $(OFLAB) --threads $(NP)
	$(LAB) report $(OFLAB)

lab-register: $(LABHERE)/registration.json
$(LABHERE)/registration.json: $(LABOUT)/kinematics.h5 $(wildcard $(LABDATA)/* $(LABDATA)/*/*)
	$(LAB) register $(OFLAB)

lab-motion: $(LABHERE)/motion.h5
$(LABHERE)/motion.h5: $(LABHERE)/registration.json
	$(LAB) motion $(OFLAB)

VARIATIONS = $(if $(INPUTS),$(notdir $(patsubst %/scene.toml,%,$(wildcard $(LABOUT)/inputs/*/scene.toml))))
lab-sheets: $(LABHERE)/sheet.h5 $(patsubst %,$(LABHERE)/inputs/%.h5,$(VARIATIONS))
$(LABHERE)/sheet.h5: $(LABOUT)/run/run.json $(LABOUT)/settings/sheet.json $(LABHERE)/view.txt
	$(call VIEW,$(CASE),$$(cat $(LABHERE)/view.txt))
$(LABHERE)/inputs/%.h5: $(LABOUT)/inputs/%/out/$(LEVEL)/run/run.json \
    $(LABOUT)/inputs/%/out/$(LEVEL)/settings/sheet.json $(LABHERE)/view.txt
	$(call VIEW,$(LABOUT)/inputs/$*,$$(cat $(LABHERE)/view.txt))

compare-measured: | $(READY) ## the same with the simulation driven by the motion that the recording shows
	+@$(SUB) SCENE=$(SCENE) DPIV=$(DPIV) lab-motion
	+@$(SUB) SCENE=$(SCENE)/out/$(LEVEL)/lab/$(LABNAME)/measured DPIV=$(abspath $(DPIV)) INPUTS=$(INPUTS) compare

# The coupled run comes first: the recording is registered against its motion.
compare-coupled: | $(READY) ## whether pressure, structure or flow differ, with the pressure measured in the chambers
	+@$(SUB) $(SCENE).kinematics
	$(LAB) pressure $(OFLAB) --ranks $(NP)
	+$(PY) -m pipeline couple $(LABHERE)/pressure --level $(LEVEL) --ranks $(NP) --target loads $(FLAGS)
	$(LAB) modelled $(OFLAB)
	+@$(SUB) SCENE=$(SCENE)/out/$(LEVEL)/lab/$(LABNAME)/modelled DPIV=$(abspath $(DPIV)) lab-register
	$(LAB) causes $(OFLAB)

# A stand-in for a laboratory: pictures of a run at PRESSURE kPa, with errors of set-up that dpiv.toml does not know.
PRESSURE ?= 21
VIRTUAL   = $(LABOUT)/virtual/$(PRESSURE)kpa
virtual-lab: | $(READY) ## a stand-in recording to try compare on, where no laboratory is at hand
	+@$(SUB) $(SCENE).kinematics
	$(LAB) virtual $(CASE) --level $(LEVEL) --pressure-kpa $(PRESSURE) $(FLAGS)
	+@$(SUB) $(patsubst $(CASES)/%,%,$(VIRTUAL)).run
	$(PY) -m pipeline sheet $(VIRTUAL) --level $(LEVEL) --view -0.075 0.12 0.115 0.275 \
	    -o $(VIRTUAL)/view.h5 $(FLAGS)
	$(LAB) recording $(VIRTUAL) --level $(LEVEL) --sheet $(VIRTUAL)/view.h5 \
	    -o $(VIRTUAL)/virtual_$(PRESSURE)kpa --pairs-hz 100
	@echo "now: make compare SCENE=$(SCENE) LEVEL=$(LEVEL) DPIV=$(VIRTUAL)/virtual_$(PRESSURE)kpa"

LAB_STUDY = $(LABOUT)/virtual/study
STUDY_RUN = $(PY) -m tests.studies.laboratory.virtual_lab --case $(CASE) --level $(LEVEL)
STUDY_NEW = -o $(LAB_STUDY)/trials.csv
# Seeds of the tables of docs/comparison.md, none of which anything was tuned on: every water's five, and more without a
# difference, since false alarms are few.
virtual-lab-study: | $(READY) ## registration, faults, verdicts: tables of docs/comparison.md (hours of CPU)
	+@$(SUB) $(SCENE).run
	@$(LAB) runs $(CASE) --level $(LEVEL) --quiet
	@$(STUDY_RUN) --write
	+@$(SUB) SCENE=$(SCENE) study-sheets
	$(PY) -m tests.studies.laboratory.registration --seeds 20 -o $(LAB_STUDY)/registration.csv \
	    --docs docs/comparison.md
	$(PY) -m tests.studies.laboratory.faults --first 501 --seeds 72 -o $(LAB_STUDY)/faults.csv --docs docs/comparison.md
	$(STUDY_RUN) $(STUDY_NEW) --first 421 --seeds 5
	$(STUDY_RUN) $(STUDY_NEW) --first 426 --seeds 15 --sets none --docs docs/comparison.md
WATERS = $(notdir $(patsubst %/scene.toml,%,$(wildcard $(LABOUT)/virtual/*/scene.toml)))
study-sheets: $(patsubst %,$(LAB_STUDY)/%.h5,nominal $(WATERS) $(VARIATIONS))
LAB_STUDY_SHEET = $(call VIEW,$(patsubst %/out/$(LEVEL)/run/run.json,%,$<),-0.08 0.12 0.10 0.28)
$(LAB_STUDY)/nominal.h5: $(LABOUT)/run/run.json
	$(LAB_STUDY_SHEET)
$(LAB_STUDY)/%.h5: $(LABOUT)/virtual/%/out/$(LEVEL)/run/run.json
	$(LAB_STUDY_SHEET)
$(LAB_STUDY)/%.h5: $(LABOUT)/inputs/%/out/$(LEVEL)/run/run.json
	$(LAB_STUDY_SHEET)
