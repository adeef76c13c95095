# The workspace, at rest and in motion (Kurniawan 2017, section 5.1, Figs 5.5 to 5.13), as published and as it is here.
#
# "Published" is the whole method of the dissertation: its line extraction (modified Hough transform, corner points,
# RANSAC, least squares), its correction of beam lengths in motion, its vote over x and yaw; on its own terms, with
# exact ranges. "Same scans" is this project's method on those scans. "All on" is this project's method on scans
# with noise, bias, quantisation and remissions, as a device gives them.

# A platform that stands in every pose looks, from scan to scan, as if it moved.
STANDING := --deskew none
PITCH := --pitch-deg 0
PUBLISHED_VOTE := solve-pose -q -f $(FRAME) --method vote $(PITCH)
OURS_POSE := solve-pose -q -f $(FRAME) $(PITCH)

# Fig. 5.5: standing on 857 places of the diagonal, with a beam of one diameter (cbd) and with the device's, which
# grows with the beam's length (bdlf).
DIAGONAL := $(OUT)/fig-5-5
DIAGONAL_RUN ?= --trajectory line --speed-m-s 0.35
DIAGONAL_cbd := --effects footprint --effects-file constant-diameter.toml
DIAGONAL_bdlf := --effects footprint
DIAGONAL_CASES := cbd-published bdlf-published cbd-same-scans bdlf-same-scans all-on

.PHONY: fig-5-5
fig-5-5: $(DIAGONAL)/report.txt
	@cat $(OUT)/$@.row

$(DIAGONAL)/%-published.csv: $(FRAME) constant-diameter.toml
	@mkdir -p $(@D)
	simulate -q --jobs 1 -f $(FRAME) $(DIAGONAL_RUN) $(DIAGONAL_$*) --truth $(@D)/$*.truth.csv \
		| extract-lines -q -f $(FRAME) --method dissertation | $(PUBLISHED_VOTE) -o $@
$(DIAGONAL)/%-same-scans.csv: $(FRAME) constant-diameter.toml
	@mkdir -p $(@D)
	simulate -q --jobs 1 -f $(FRAME) $(DIAGONAL_RUN) $(DIAGONAL_$*) \
		| extract-lines -q -f $(FRAME) $(STANDING) | $(OURS_POSE) -o $@
$(DIAGONAL)/all-on.csv: $(FRAME)
	@mkdir -p $(@D)
	simulate -q --jobs 1 -f $(FRAME) $(DIAGONAL_RUN) --effects reference \
		| extract-lines -q -f $(FRAME) $(STANDING) | $(OURS_POSE) -o $@

$(DIAGONAL)/report.txt: $(DIAGONAL_CASES:%=$(DIAGONAL)/%.csv) $(OUT)/bound.json row.py
	report -q --truth $(@D)/bdlf.truth.csv --html $(@D)/report.html \
		--title 'Standing on the diagonal: constant beam diameter against the device'\''s' $(filter %.csv,$^) > $@
	report -q --truth $(@D)/bdlf.truth.csv --json $(filter %.csv,$^) > $(@D)/report.json
	$(PYTHON) row.py $(OUT) fig-5-5 'x max 13 mm, yaw within 0.2 deg; y, z, roll 0' \
		'cbd: x max $(call of,cbd-published,x.max_mm,1) mm, yaw max $(call of,cbd-published,yaw.max_deg,2) deg, votes $(call of,cbd-published,scans.votes.min,0) to $(call of,cbd-published,scans.votes.max,0); bdlf: x max $(call of,bdlf-published,x.max_mm,1) mm, yaw max $(call of,bdlf-published,yaw.max_deg,2) deg, votes $(call of,bdlf-published,scans.votes.min,0) to $(call of,bdlf-published,scans.votes.max,0)' \
		'x $(call of,all-on,x.rms_mm,2) mm rms, max $(call of,all-on,x.max_mm,1) mm; yaw $(call of,all-on,yaw.rms_deg,3) deg rms' \
		'x $(call bound,remission.x_rms_mm,2) mm, yaw $(call bound,remission.yaw_rms_deg,3) deg rms'
# A figure of a report beside the target: run, statistic, digits. A figure of the bound.
of = {$(@D)/report.json:$1:$2:$3}
bound = {$(OUT)/bound.json::$1:$2}

# What the information in one scan allows over the feasible workspace, with remissions and with ranges only.
$(OUT)/bound.json: $(FRAME) bound.py
	@mkdir -p $(@D)
	$(PYTHON) bound.py $(FRAME) > $@

# Figs 5.6 to 5.10: a scan every 2 cm of the whole workspace. SHARD=i/n with the target workspace-part does one
# part of it, on any machine that shares OUT; `workspace PARTS=n` then puts the parts together.
WORKSPACE := $(OUT)/workspace
WORKSPACE_STEP ?= 0.02
WORKSPACE_RUN := --trajectory grid --step-m $(WORKSPACE_STEP) --z-range 0.5,4
WORKSPACE_CASES := published same-scans all-on
PARTS ?= 4
WORKSPACE_PARTS := $(foreach i,$(shell seq $(PARTS)),$i-of-$(PARTS))
FIGS_WORKSPACE := fig-5-6 fig-5-7 fig-5-8 fig-5-9 fig-5-10

SHARD ?=
.PHONY: workspace-part workspace $(FIGS_WORKSPACE)
workspace-part: $(if $(SHARD),$(WORKSPACE_CASES:%=$(WORKSPACE)/$(subst /,-of-,$(SHARD))/%.csv))
	@$(if $(SHARD),,echo 'SHARD=i/n is missing' >&2; exit 2)
workspace $(FIGS_WORKSPACE): $(WORKSPACE)/report.txt
	@cat $(if $(filter fig-%,$@),$(OUT)/$@.row,$<)

$(WORKSPACE)/%/published.csv: $(FRAME)
	@mkdir -p $(@D)
	simulate -q --jobs 1 -f $(FRAME) $(WORKSPACE_RUN) --effects footprint --shard $(subst -of-,/,$*) \
		--truth $(@D)/truth.csv | extract-lines -q -f $(FRAME) --method dissertation | $(PUBLISHED_VOTE) -o $@
$(WORKSPACE)/%/same-scans.csv: $(FRAME)
	@mkdir -p $(@D)
	simulate -q --jobs 1 -f $(FRAME) $(WORKSPACE_RUN) --effects footprint --shard $(subst -of-,/,$*) \
		| extract-lines -q -f $(FRAME) $(STANDING) | $(OURS_POSE) -o $@
$(WORKSPACE)/%/all-on.csv: $(FRAME)
	@mkdir -p $(@D)
	simulate -q --jobs 1 -f $(FRAME) $(WORKSPACE_RUN) --effects reference --shard $(subst -of-,/,$*) \
		| extract-lines -q -f $(FRAME) $(STANDING) | $(OURS_POSE) -o $@

# The three parts of Fig. 5.8.
ZONE_low := z<=3.5
ZONE_left := z>3.5,y<=0
ZONE_right := z>3.5,y>0
WORKSPACE_FILES := $(foreach m,$(WORKSPACE_CASES),$(foreach p,$(WORKSPACE_PARTS),$(WORKSPACE)/$p/$m.csv))
WORKSPACE_TRUTH := $(foreach p,$(WORKSPACE_PARTS),--truth $(WORKSPACE)/$p/truth.csv)
WORKSPACE_MERGE := --merge $(foreach m,$(WORKSPACE_CASES),$(foreach p,$(WORKSPACE_PARTS),$m=$(WORKSPACE)/$p/$m.csv))

$(WORKSPACE)/report.txt: $(WORKSPACE_FILES) $(OUT)/bound.json row.py
	report -q $(WORKSPACE_TRUTH) --html $(@D)/report.html --cell-m 0.1 \
		--title 'The workspace, a scan every $(WORKSPACE_STEP) m' $(WORKSPACE_MERGE) > $@
	report -q $(WORKSPACE_TRUTH) --json $(WORKSPACE_MERGE) > $(@D)/report.json
	for zone in 'low=$(ZONE_low)' 'left=$(ZONE_left)' 'right=$(ZONE_right)'; do \
		report -q $(WORKSPACE_TRUTH) --json --zone "$$zone" $(WORKSPACE_MERGE) > $(@D)/$${zone%%=*}.json; \
	done
	$(PYTHON) row.py $(OUT) fig-5-6 'y, z: "almost zero"' \
		'y max $(call of,published,y.max_mm,2), z max $(call of,published,z.max_mm,2) mm' \
		'y $(call of,all-on,y.rms_mm,2), z $(call of,all-on,z.rms_mm,2) mm rms' \
		'y $(call bound,remission.y_rms_mm,2), z $(call bound,remission.z_rms_mm,2) mm rms'
	$(PYTHON) row.py $(OUT) fig-5-7 'roll: "satisfactory"' 'roll max $(call of,published,roll.max_deg,4) deg' \
		'roll $(call of,all-on,roll.rms_deg,4) deg rms' 'roll $(call bound,remission.roll_rms_deg,4) deg rms'
	$(PYTHON) row.py $(OUT) fig-5-8 'x max 15 mm for z to 3.5 m, 2.5 m above' \
		'x max: z to 3.5 m $(call in_zone,low,published,x.max_mm,1), above $(call in_zone,left,published,x.max_mm,1) (y to 0) and $(call in_zone,right,published,x.max_mm,1) mm' \
		'x max: $(call in_zone,low,all-on,x.max_mm,1), $(call in_zone,left,all-on,x.max_mm,1), $(call in_zone,right,all-on,x.max_mm,1) mm; $(call of,all-on,x.rms_mm,2) mm rms' \
		'x $(call bound,remission.x_rms_mm,2) mm rms'
	$(PYTHON) row.py $(OUT) fig-5-9 'votes: all for z to 3.5 m, fewer above' \
		'votes $(call in_zone,low,published,scans.votes.min,0) to $(call in_zone,low,published,scans.votes.max,0) for z to 3.5 m, $(call in_zone,left,published,scans.votes.min,0) to $(call in_zone,left,published,scans.votes.max,0) and $(call in_zone,right,published,scans.votes.min,0) to $(call in_zone,right,published,scans.votes.max,0) above; solved $(call of,published,scans.solved_pct,2) %' \
		'edges $(call of,all-on,scans.edges.min,0) to $(call of,all-on,scans.edges.max,0); solved $(call of,all-on,scans.solved_pct,2) %' '8 edges'
	$(PYTHON) row.py $(OUT) fig-5-10 'yaw: within 0.2 deg' \
		'yaw max: z to 3.5 m $(call in_zone,low,published,yaw.max_deg,2), above $(call in_zone,left,published,yaw.max_deg,2) and $(call in_zone,right,published,yaw.max_deg,2) deg' \
		'yaw max $(call of,all-on,yaw.max_deg,2), $(call of,all-on,yaw.rms_deg,3) deg rms' \
		'yaw $(call bound,remission.yaw_rms_deg,3) deg rms'
in_zone = {$(@D)/$1.json:$2:$3:$4}

# Figs 5.11 and 5.13: the diagonal at 1, 2 and 3 m/s, the velocity left in the scans and taken out of them: by the
# published correction of beam lengths with the known motion, and by what the scans show themselves.
SPEED := $(OUT)/speed
SPEEDS := 1 2 3
SPEED_CASES := published-none published-compensated same-scans all-on
speed = $(patsubst %ms,%,$*)

.PHONY: fig-5-11 fig-5-13
fig-5-11 fig-5-13: $(SPEED)/report.txt
	@cat $(OUT)/$@.row

$(SPEED)/%/scans.csv: $(FRAME)
	@mkdir -p $(@D)
	simulate -q --jobs 1 -f $(FRAME) --trajectory line --speed-m-s $(speed) --effects footprint,motion \
		--truth $(@D)/truth.csv -o $@
%/published-none.csv: %/scans.csv
	extract-lines -q -f $(FRAME) --method dissertation $< | $(PUBLISHED_VOTE) -o $@
%/published-compensated.csv: %/scans.csv
	extract-lines -q -f $(FRAME) --motion $*/truth.csv --deskew-method beam-length $< | $(PUBLISHED_VOTE) -o $@
$(SPEED)/%/same-scans.csv: $(SPEED)/%/scans.csv
	extract-lines -q -f $(FRAME) $< | $(OURS_POSE) -o $@
$(SPEED)/%/all-on.csv: $(FRAME)
	@mkdir -p $(@D)
	simulate -q --jobs 1 -f $(FRAME) --trajectory line --speed-m-s $(speed) --effects reference,motion \
		| extract-lines -q -f $(FRAME) | $(OURS_POSE) -o $@

$(SPEED)/%/report.json: $(SPEED_CASES:%=$(SPEED)/\%/%.csv)
	report -q --truth $(@D)/truth.csv --html $(@D)/report.html --title 'The diagonal at $(speed) m/s' $^ \
		> $(@D)/report.txt
	report -q --truth $(@D)/truth.csv --json $^ > $@
$(SPEED)/report.txt: $(SPEEDS:%=$(SPEED)/%ms/report.json) $(OUT)/bound.json row.py
	tail -n +1 $(SPEEDS:%=$(SPEED)/%ms/report.txt) > $@
	$(PYTHON) row.py $(OUT) fig-5-11 'x below 20 mm at 1 and 2 m/s, worse at 3 m/s above z = 2.5 m; y 20, z 10 mm (max, 3 m/s)' \
		'$(call at_speeds,published-none,x.max_mm,0,x max) mm; $(call at_speeds,published-none,y.max_mm,1,y) mm; $(call at_speeds,published-none,z.max_mm,1,z) mm' \
		'not left in: see fig-5-13' ''
	$(PYTHON) row.py $(OUT) fig-5-13 'y, z, roll "perfect"; x as without up to z = 2.74 m, worse above' \
		'$(call at_speeds,published-compensated,x.max_mm,0,x max) mm; $(call at_speeds,published-compensated,y.max_mm,1,y) mm; $(call at_speeds,published-compensated,z.max_mm,1,z) mm' \
		'$(call at_speeds,all-on,x.rms_mm,2,x) mm rms; $(call at_speeds,all-on,y.rms_mm,2,y) mm; $(call at_speeds,all-on,z.rms_mm,2,z) mm' \
		'at rest x $(call bound,remission.x_rms_mm,2), y $(call bound,remission.y_rms_mm,2), z $(call bound,remission.z_rms_mm,2) mm rms'
# Run, statistic, digits, name: the figures of the three speeds.
at_speeds = $4 $(subst $(space),$(comma) ,$(foreach s,$(SPEEDS),{$(@D)/$sms/report.json:$1:$2:$3}))
comma := ,
space := $() $()

# Tables 4.1 and 4.4: line extractors on scans of an office, and the modified Hough transform against the whole one.
# The times of the table differ from run to run; the rows have what does not.
LINES := $(OUT)/line-extraction
CARGO ?= cargo

.PHONY: table-4-1 table-4-4
table-4-1 table-4-4: $(LINES)/table.txt
	@cat $(OUT)/$@.row

$(LINES)/table.txt: ../benches/lines_table.rs lines_rows.py
	@mkdir -p $(@D)
	(cd .. && $(CARGO) bench --quiet --locked --bench lines_table) > $@.partial
	$(PYTHON) lines_rows.py $(OUT) $@.partial
	mv $@.partial $@

# Beyond: what each effect costs, and what the edges of one strip are worth under it.
ABLATION := $(OUT)/ablation
ABLATION_SCANS ?= 2000

.PHONY: ablation
ablation: $(ABLATION)/table.md
	@cat $<
$(ABLATION)/table.md: $(FRAME) ablation.py
	$(PYTHON) ablation.py $(FRAME) $(ABLATION) $(OUT) $(ABLATION_SCANS)

EXPERIMENTS += fig-5-5 $(FIGS_WORKSPACE) fig-5-11 fig-5-13 table-4-1 table-4-4 ablation
