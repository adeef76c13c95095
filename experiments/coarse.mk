# What comes of stopping after the coarse line (Kurniawan 2017, Figs 5.14 and 5.15): the PC/104 on the serial port
# was too slow for more than the Hough transform, whose best cell is the line, 10 mm high and 0.1 deg wide; the
# Ethernet based system had the time for all steps. The same scans of four loops at 1 m/s three times: coarse,
# as published, all on.

COARSE := $(OUT)/coarse
COARSE_RUN ?= --trajectory loop --speed-m-s 1 --loops 4 --dwell 1s --effects reference,-bias,motion --seed 14

EXPERIMENTS += fig-5-14 fig-5-15

.PHONY: fig-5-14 fig-5-15
fig-5-14 fig-5-15: $(COARSE)/report.txt
	@cat $(OUT)/$@.row

$(COARSE)/scans.mcap: $(FRAME)
	@mkdir -p $(@D)
	simulate -q -f $(FRAME) $(COARSE_RUN) --truth $(@D)/truth.csv --imu $(@D)/imu.csv --format mcap -o $@

COARSE_IMU := --imu-pitch-sigma-deg 0 --imu $(COARSE)/imu.csv --format csv
$(COARSE)/coarse.csv: $(COARSE)/scans.mcap
	extract-lines -q -f $(FRAME) --method modified-hough --coarse $< | solve-pose -q -f $(FRAME) $(COARSE_IMU) -o $@
$(COARSE)/published.csv: $(COARSE)/scans.mcap
	extract-lines -q -f $(FRAME) --method dissertation $< \
		| solve-pose -q -f $(FRAME) --method vote $(COARSE_IMU) -o $@
$(COARSE)/all-on.csv: $(COARSE)/scans.mcap
	extract-lines -q -f $(FRAME) $< | solve-pose -q -f $(FRAME) $(COARSE_IMU) -o $@

$(COARSE)/report.txt: $(foreach m,coarse published all-on,$(COARSE)/$m.csv) $(OUT)/bound.json row.py
	report -q --truth $(@D)/truth.csv --html $(@D)/report.html --title 'Coarse lines against the whole way' \
		$(filter %.csv,$^) > $@
	report -q --truth $(@D)/truth.csv --json $(filter %.csv,$^) > $(@D)/report.json
	$(PYTHON) row.py $(OUT) fig-5-14 'coarse lines only: "very noisy"' \
		'y {$(@D)/report.json:coarse:y.rms_mm:1}, z {$(@D)/report.json:coarse:z.rms_mm:1} mm rms, max {$(@D)/report.json:coarse:y.max_mm:0}, {$(@D)/report.json:coarse:z.max_mm:0} mm' \
		'the same' '10 mm cells: 2.9 mm'
	$(PYTHON) row.py $(OUT) fig-5-15 'whole method: "better"' \
		'y {$(@D)/report.json:published:y.rms_mm:1}, z {$(@D)/report.json:published:z.rms_mm:1} mm rms, max {$(@D)/report.json:published:y.max_mm:0}, {$(@D)/report.json:published:z.max_mm:0} mm' \
		'y {$(@D)/report.json:all-on:y.rms_mm:2}, z {$(@D)/report.json:all-on:z.rms_mm:2} mm rms, max {$(@D)/report.json:all-on:y.max_mm:1}, {$(@D)/report.json:all-on:z.max_mm:1} mm' \
		'y $(call bound,remission.y_rms_mm,2), z $(call bound,remission.z_rms_mm,2) mm rms'
