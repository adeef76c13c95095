# The delay of the measurement (Kurniawan 2017, section 2.4, Fig. 5.21): poses come 60 ms late. What is left of the
# error over four loops at 3.13 m/s with nothing done about it, with the total delay taken out (from the scanner's
# stamp to now: it holds the error of the clock's setting, here 70 ms, so that the spikes grow), with the plain
# cross-correlation's, with the best whole number of scans found by hand, and with the fit's.

DELAY := $(OUT)/delay
DELAY_RUN ?= --trajectory loop --profile quintic --speed-m-s 3.13 --from-pose 0,-4,0.6 --to-pose 0,4,3.4 \
	--loops 4 --dwell 1s --lag 60ms --effects reference,motion --seed 21
DELAY_TOTAL_MS := 130
DELAY_HOW := none total xcorr adjusted fit

EXPERIMENTS += fig-5-21

.PHONY: fig-5-21
fig-5-21: $(DELAY)/report.txt
	@cat $(OUT)/$@.row

$(DELAY)/scans.mcap: $(FRAME)
	@mkdir -p $(@D)
	simulate -q -f $(FRAME) $(DELAY_RUN) --truth $(@D)/truth.csv --desired $(@D)/desired.csv \
		--imu $(@D)/imu.csv --format mcap -o $@

$(DELAY)/none.csv: $(DELAY)/scans.mcap
	extract-lines -q -f $(FRAME) $< | solve-pose -q -f $(FRAME) --imu-pitch-sigma-deg 0 \
		--imu $(DELAY)/imu.csv --format csv -o $@

# The delays: found, or set.
$(DELAY)/fit.json: $(DELAY)/none.csv
	timesync delay --json --desired $(DELAY)/desired.csv $< > $@
$(DELAY)/xcorr.json: $(DELAY)/none.csv
	timesync delay --json --method xcorr --desired $(DELAY)/desired.csv $< > $@
$(DELAY)/total.json: delay.mk
	@mkdir -p $(@D)
	echo '{"delay_s": $(DELAY_TOTAL_MS)e-3, "sigma_s": 0}' > $@
# By hand: the whole number of scans that leaves the least error.
$(DELAY)/adjusted.json: $(DELAY)/none.csv by_hand.py
	$(PYTHON) by_hand.py $(DELAY)/desired.csv $< > $@

# The delay taken out: the pose is carried to its stamp by the desired motion, eq. 4.26.
define delay_taken
$(DELAY)/$1.csv: $(DELAY)/$1.json $(DELAY)/none.csv
	compensate-delay -q --delay-from $$< --stamps used --motion $(DELAY)/desired.csv $(DELAY)/none.csv -o $$@
endef
$(foreach h,total xcorr adjusted fit,$(eval $(call delay_taken,$h)))

$(DELAY)/report.txt: $(DELAY_HOW:%=$(DELAY)/%.csv) $(OUT)/bound.json row.py
	report -q --desired $(@D)/desired.csv --html $(@D)/report.html --title 'The delay taken out by five ways' \
		$(filter %.csv,$^) > $@
	report -q --desired $(@D)/desired.csv --json $(filter %.csv,$^) > $(@D)/report.json
	$(PYTHON) row.py $(OUT) fig-5-21 'spikes stay until the delay is adjusted by hand' \
		'y max {$(@D)/report.json:none:y.max_mm:0} mm as measured, total {$(@D)/report.json:total:y.max_mm:0}, cross-correlation {$(@D)/report.json:xcorr:y.max_mm:0}, by hand {$(@D)/report.json:adjusted:y.max_mm:0} mm' \
		'y max {$(@D)/report.json:fit:y.max_mm:1}, rms {$(@D)/report.json:fit:y.rms_mm:2} mm' 'y $(call bound,remission.y_rms_mm,2) mm rms'
