# Strip designs: what gamma, width and spacing of the ceiling's strips are worth, predicted by
# `simulate --dilution` for all and checked by simulated scans through the chain for some; and over
# which yaw the walls' reflectors are hit (Kurniawan 2017, eq. 3.104), formula beside scans.

.PHONY: strip-designs
EXPERIMENTS += $(OUT)/designs/table.txt
strip-designs: $(OUT)/designs/table.txt
	@cat $<; ! grep -q ^MISSED $< || exit 4

$(OUT)/designs/table.txt: $(FRAME) designs.py
	@mkdir -p $(@D)
	$(PYTHON) designs.py $(FRAME) $(abspath $(@D)) > $@.partial || test $$? = 4
	mv $@.partial $@

.PHONY: yaw-range
yaw-range:
	@mkdir -p $(OUT)
	@$(PYTHON) yaw_range.py $(FRAME) $(abspath $(OUT))/yaw-range.csv

# Kurniawan 2017, Fig. 3.13: the same with its page and its row of the summary.
YAW := $(OUT)/yaw
EXPERIMENTS += fig-3-13
.PHONY: fig-3-13
fig-3-13: $(YAW)/report.txt
	@cat $(OUT)/$@.row

$(YAW)/report.txt: $(FRAME) yaw_range.py yaw_row.py
	@mkdir -p $(@D)
	$(PYTHON) yaw_range.py $(FRAME) $(@D)/yaw-range.csv > $@
	! report --help | grep -q '^  frame ' || report frame $(FRAME) --html $(@D)/report.html > $(@D)/frame.txt
	$(PYTHON) yaw_row.py $(@D)/yaw-range.csv $(OUT)
