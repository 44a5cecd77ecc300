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

VARIATIONS = $(if $(INPUTS),$(notdir $(patsubst %/scene.toml,%,$(wildcard $(LABOUT)/inputs/*/scene.toml))))
lab-sheets: $(LABHERE)/sheet.h5 $(patsubst %,$(LABHERE)/inputs/%.h5,$(VARIATIONS))
$(LABHERE)/sheet.h5: $(LABOUT)/run/run.json $(LABOUT)/settings/sheet.json $(LABHERE)/view.txt
	$(call VIEW,$(CASE),$$(cat $(LABHERE)/view.txt))
$(LABHERE)/inputs/%.h5: $(LABOUT)/inputs/%/out/$(LEVEL)/run/run.json \
    $(LABOUT)/inputs/%/out/$(LEVEL)/settings/sheet.json $(LABHERE)/view.txt
	$(call VIEW,$(LABOUT)/inputs/$*,$$(cat $(LABHERE)/view.txt))

# no longer there: only names that the list of targets in the Makefile still has
lab-motion study-sheets:
compare-measured: ; $(error $@ is not there any more; use compare) ## not there any more
compare-coupled: ; $(error $@ is not there any more; use compare) ## not there any more
virtual-lab-study: ; $(error $@ is not there any more; docs/record has its tables) ## not there any more

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
	    -o $(VIRTUAL)/virtual_$(PRESSURE)kpa
	@echo "now: make compare SCENE=$(SCENE) LEVEL=$(LEVEL) DPIV=$(VIRTUAL)/virtual_$(PRESSURE)kpa"
