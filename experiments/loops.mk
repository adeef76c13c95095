# Point-to-point loops, slow and fast, through the whole chain (Kurniawan 2017, Figs 5.22 to 5.24): a platform that
# follows its command 60 ms late and vibrates in roll, pitch and yaw, an IMU with its noise and bias, the delay
# found from the run itself and taken out by the desired motion. The same once as published: its lines, its vote,
# the delay in whole scans by hand.

LOOPS := $(OUT)/loops
LOOPS_EFFECTS ?= reference,motion,imu
LOOP := --trajectory loop --profile quintic --from-pose 0,-4,0.6 --to-pose 0,4,3.4 --dwell 1s --lag 60ms
RUN_slow := $(LOOP) --speed-m-s 0.4 --wobble-deg 0.3,0.1,0.05 --wobble-hz 0.7 --seed 22
RUN_fast := $(LOOP) --speed-m-s 3.13 --loops 2 --wobble-deg 0.5,0.2,0.1 --wobble-hz 2 --seed 24

EXPERIMENTS += fig-5-22 fig-5-23 fig-5-24

# 5.22 and 5.23 are one run: positions and orientation, then x, votes and yaw.
.PHONY: fig-5-22 fig-5-23 fig-5-24
fig-5-22 fig-5-23: $(LOOPS)/slow/report.txt
	@cat $(OUT)/$@.row
fig-5-24: $(LOOPS)/fast/report.txt
	@cat $(OUT)/$@.row

$(LOOPS)/%/scans.mcap: $(FRAME)
	@mkdir -p $(@D)
	simulate -q -f $(FRAME) $(RUN_$*) --effects $(LOOPS_EFFECTS) --imu-rate-hz 100 --truth $(@D)/truth.csv \
		--desired $(@D)/desired.csv --imu $(@D)/imu.csv --format mcap -o $@

%/measured.csv: %/scans.mcap
	extract-lines -q -f $(FRAME) --imu $*/imu.csv $< \
		| solve-pose -q -f $(FRAME) --imu $*/imu.csv --format csv -o $@
%/measured-published.csv: %/scans.mcap
	extract-lines -q -f $(FRAME) --method dissertation $< \
		| solve-pose -q -f $(FRAME) --method vote --imu $*/imu.csv --format csv -o $@
%/delay.json: %/measured.csv
	timesync delay --json --desired $*/desired.csv $< > $@
%/delay-published.json: %/measured-published.csv by_hand.py
	$(PYTHON) by_hand.py $*/desired.csv $< > $@
%/all-on.csv: %/delay.json %/measured.csv
	compensate-delay -q --delay-from $< --stamps used --motion $*/desired.csv $*/measured.csv -o $@
%/published.csv: %/delay-published.json %/measured-published.csv
	compensate-delay -q --delay-from $< --stamps used --motion $*/desired.csv $*/measured-published.csv -o $@

$(LOOPS)/%/report.txt: $(LOOPS)/%/published.csv $(LOOPS)/%/all-on.csv $(OUT)/bound.json row.py
	report -q --desired $(@D)/desired.csv --imu $(@D)/imu.csv --html $(@D)/report.html \
		--title 'Loops, $*: 60 ms of delay taken out' --json $(filter %.csv,$^) > $(@D)/report.json
	$(PYTHON) row.py $(OUT) $(ROW_$*) \
		'y {$(@D)/report.json:published:y.max_mm:0}, z {$(@D)/report.json:published:z.max_mm:0} mm (max)' \
		'y {$(@D)/report.json:all-on:y.max_mm:1}, z {$(@D)/report.json:all-on:z.max_mm:1} mm (max), {$(@D)/report.json:all-on:y.rms_mm:2}, {$(@D)/report.json:all-on:z.rms_mm:2} mm rms; delay {$(@D)/delay.json::delay_s:5} s' \
		'y $(call bound,remission.y_rms_mm,2), z $(call bound,remission.z_rms_mm,2) mm rms; delay 0.06 s'
	test $* != slow || $(PYTHON) row.py $(OUT) fig-5-23 'votes 5 or more (but once), yaw below 1 deg' \
		'x {$(@D)/report.json:published:x.max_mm:0} mm, yaw {$(@D)/report.json:published:yaw.max_deg:2} deg (max), {$(@D)/report.json:published:scans.votes.mean:1} votes on average' \
		'x {$(@D)/report.json:all-on:x.max_mm:0} mm, yaw {$(@D)/report.json:all-on:yaw.max_deg:2} deg (max), x {$(@D)/report.json:all-on:x.rms_mm:1} mm rms' \
		'x 29 mm rms for 0.5 deg of pitch'
	report -q --desired $(@D)/desired.csv --imu $(@D)/imu.csv $(filter %.csv,$^) > $@
ROW_slow := fig-5-22 'friction and vibration: errors grow with y'
ROW_fast := fig-5-24 'y, z 40 mm (max)'

# The fast loops live, in real time (half a minute): an emulated scanner on the loopback, an emulated IMU on a
# pseudo terminal. Not the same bytes twice; the tolerance is that of the gates, and of the delay against 60 ms.
LIVE := $(LOOPS)/live
LIVE_GATES := scans.solved_pct<99 y.rms_mm>0.8 z.rms_mm>1.2 y.max_mm>5 z.max_mm>6
LIVE_DELAY_MS := 2

.PHONY: fig-5-22-live
fig-5-22-live: $(LIVE)/report.txt
	@cat $(OUT)/$@.row

$(LIVE)/measured.csv: $(LOOPS)/fast/scans.mcap live live_stamps.py
	FRAME=$(FRAME) PYTHON=$(PYTHON) ./live $(@D) $$(($$(wc -l < $(LOOPS)/fast/truth.csv) - 6)) \
		$(RUN_fast) --effects $(LOOPS_EFFECTS)

$(LIVE)/report.txt: $(LIVE)/all-on.csv $(OUT)/bound.json row.py
	$(PYTHON) -c 'import json, sys; d = json.load(open("$(LIVE)/delay.json"))["delay_s"]; \
		sys.exit(f"delay {d} s" if abs(d - 0.06) > $(LIVE_DELAY_MS)e-3 else 0)'
	report -q --desired $(LIVE)/desired.csv --html $(LIVE)/report.html --title 'Fast loops, live' \
		$(patsubst %,--fail-if '%',$(LIVE_GATES)) $< > $@
	report -q --desired $(LIVE)/desired.csv --json $< > $(LIVE)/report.json
	$(PYTHON) row.py $(OUT) fig-5-22-live 'y, z 40 mm (max)' '' \
		'y {$(LIVE)/report.json:all-on:y.max_mm:1}, z {$(LIVE)/report.json:all-on:z.max_mm:1} mm (max), {$(LIVE)/report.json:all-on:y.rms_mm:2}, {$(LIVE)/report.json:all-on:z.rms_mm:2} mm rms; delay {$(LIVE)/delay.json::delay_s:4} s' \
		'y $(call bound,remission.y_rms_mm,2), z $(call bound,remission.z_rms_mm,2) mm rms; delay 0.06 s'
