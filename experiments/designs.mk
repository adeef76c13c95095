# Strip designs: what gamma, width and spacing of the ceiling's strips are worth, predicted by
# `simulate --dilution` for all and checked by simulated scans through the chain for some; and over
# which yaw the walls' reflectors are hit (Kurniawan 2017, eq. 3.104), formula beside scans.

.PHONY: strip-designs
strip-designs:
	@$(PYTHON) designs.py $(FRAME) $(abspath $(OUT))/designs

.PHONY: yaw-range
yaw-range:
	@$(PYTHON) yaw_range.py $(FRAME) $(abspath $(OUT))/yaw-range
