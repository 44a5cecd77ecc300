# Comparison with a laboratory (docs/comparison.md). Its runs beside the nominal one are scenes of their own, written when it
# is known what they are: each step is a make of its own. INPUTS= (empty) leaves those runs out.
# Registration comes first: it asks for what dpiv.toml leaves out before anything is solved.
INPUTS ?= yes
SUB     = $(MAKE) --no-print-directory LEVEL=$(LEVEL) NP=$(NP) QUIET=$(QUIET)
CASE    = $(CASES)/$(SCENE)
LABOUT  = $(CASE)/out/$(LEVEL)
LABDATA = $(patsubst %/,%,$(patsubst %/dpiv.toml,%,$(DPIV)))
LABNAME = $(notdir $(realpath $(LABDATA)))
LAB     = $(PY) -m postprocess.lab
OFLAB   = $(CASE) --level $(LEVEL) --dpiv $(DPIV) $(FLAGS)

compare: | $(READY) ## SCENE against laboratory data: make compare SCENE=single_finger DPIV=folder [LEVEL=..]
	@test $(words $(DPIV)) = 1 || { echo "give DPIV=folder, where the laboratory's dpiv.toml is, a path without spaces (docs/comparison.md)" >&2; exit 2; }
	+@$(SUB) SCENE=$(SCENE) DPIV=$(DPIV) lab-register
	+@$(SUB) $(SCENE).run
	$(if $(INPUTS),@$(LAB) runs $(CASE) --level $(LEVEL) $(FLAGS),@rm -rf $(LABOUT)/lab/$(LABNAME)/inputs)
	+@$(SUB) SCENE=$(SCENE) DPIV=$(DPIV) INPUTS=$(INPUTS) lab-sheets
	$(LAB) compare $(OFLAB) --threads $(NP)
	$(LAB) report $(OFLAB)

lab-register: $(LABOUT)/lab/$(LABNAME)/registration.json
$(LABOUT)/lab/$(LABNAME)/registration.json: $(LABOUT)/kinematics.h5 $(wildcard $(LABDATA)/* $(LABDATA)/*/*)
	$(LAB) register $(OFLAB)

VARIATIONS = $(if $(INPUTS),$(notdir $(patsubst %/scene.toml,%,$(wildcard $(LABOUT)/inputs/*/scene.toml))))
lab-sheets: $(LABOUT)/lab/$(LABNAME)/sheet.h5 $(patsubst %,$(LABOUT)/lab/$(LABNAME)/inputs/%.h5,$(VARIATIONS))
$(LABOUT)/lab/$(LABNAME)/sheet.h5: $(LABOUT)/run/run.json $(LABOUT)/settings/sheet.json $(LABOUT)/lab/$(LABNAME)/view.txt
	$(PY) -m pipeline.sheet $(CASE) --level $(LEVEL) --view $$(cat $(@D)/view.txt) -o $@ $(FLAGS)
define variation_rule
$(LABOUT)/lab/$(LABNAME)/inputs/$(1).h5: $(addprefix $(LABOUT)/inputs/$(1)/out/$(LEVEL)/,run/run.json settings/sheet.json) $(LABOUT)/lab/$(LABNAME)/view.txt
	$(PY) -m pipeline.sheet $(LABOUT)/inputs/$(1) --level $(LEVEL) --view $$$$(cat $(LABOUT)/lab/$(LABNAME)/view.txt) -o $$@ $(FLAGS)
endef
$(foreach v,$(VARIATIONS),$(eval $(call variation_rule,$(v))))

compare-measured: | $(READY) ## the same with the simulation driven by the motion that the recording shows
	+@$(SUB) SCENE=$(SCENE) DPIV=$(DPIV) lab-register
	$(LAB) motion $(OFLAB)
	+@$(SUB) SCENE=$(SCENE)/out/$(LEVEL)/lab/$(LABNAME)/measured DPIV=$(abspath $(DPIV)) INPUTS=$(INPUTS) compare

# A stand-in for a laboratory: pictures of a run at PRESSURE kPa, with errors of set-up that its dpiv.toml does not know.
PRESSURE ?= 21
VIRTUAL   = $(LABOUT)/virtual/$(PRESSURE)kpa
virtual-lab: | $(READY) ## a stand-in recording to try compare on, where no laboratory is at hand
	+@$(SUB) $(SCENE).kinematics
	$(LAB) virtual $(CASE) --level $(LEVEL) --pressure-kpa $(PRESSURE) $(FLAGS)
	+@$(SUB) $(patsubst $(CASES)/%,%,$(VIRTUAL)).run
	$(PY) -m pipeline.sheet $(VIRTUAL) --level $(LEVEL) --view -0.075 0.12 0.115 0.275 -o $(VIRTUAL)/view.h5 $(FLAGS)
	$(PY) -m postprocess.lab.virtual.virtual_laboratory $(VIRTUAL) --level $(LEVEL) --sheet $(VIRTUAL)/view.h5 -o $(VIRTUAL)/virtual_$(PRESSURE)kpa --pairs-hz 100
	@echo "now: make compare SCENE=$(SCENE) LEVEL=$(LEVEL) DPIV=$(VIRTUAL)/virtual_$(PRESSURE)kpa"

LAB_STUDY = $(LABOUT)/virtual/study
virtual-lab-study: | $(READY) ## registration, verdicts and coverage over 20 seeds; tables into docs/comparison.md (an hour)
	+@$(SUB) $(SCENE).vortices
	@$(LAB) runs $(CASE) --level $(LEVEL) --quiet
	$(LAB) virtual $(CASE) --level $(LEVEL) --pressure-kpa 21 --quiet
	+@$(SUB) SCENE=$(SCENE) study-sheets
	$(PY) -m tests.studies.laboratory.registration --seeds 20 -o $(LAB_STUDY)/registration.csv --docs docs/comparison.md
	$(PY) -m tests.studies.laboratory.virtual_lab --case $(CASE) --level $(LEVEL) --seeds 20 -o $(LAB_STUDY)/trials.csv --docs docs/comparison.md
study-sheets: $(LAB_STUDY)/nominal.h5 $(LAB_STUDY)/21kpa.h5 $(patsubst %,$(LAB_STUDY)/%.h5,$(VARIATIONS))
LAB_STUDY_SHEET = $(PY) -m pipeline.sheet $(patsubst %/out/$(LEVEL)/run/run.json,%,$<) --level $(LEVEL) --view -0.08 0.12 0.10 0.28 -o $@ $(FLAGS)
$(LAB_STUDY)/nominal.h5: $(LABOUT)/run/run.json
	$(LAB_STUDY_SHEET)
$(LAB_STUDY)/21kpa.h5: $(LABOUT)/virtual/21kpa/out/$(LEVEL)/run/run.json
	$(LAB_STUDY_SHEET)
$(LAB_STUDY)/%.h5: $(LABOUT)/inputs/%/out/$(LEVEL)/run/run.json
	$(LAB_STUDY_SHEET)
