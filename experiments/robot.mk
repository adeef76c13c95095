# Eleven poses before and after the upper pulleys' height was changed in the controller (Kurniawan 2017,
# Tables 5.1 and 5.2, Figs 5.19 and 5.20). A simulated robot: its controller winds cables by robot.toml, the
# platform goes where the pulleys of robot-real.toml put it, the chain measures it there. The dissertation
# turned the height by hand; here `report robot` estimates it from the measured poses.

ELEVEN := $(OUT)/eleven
ELEVEN_EFFECTS ?= reference,motion
BELIEF := ../testdata/robot.toml
REAL := ../testdata/robot-real.toml

EXPERIMENTS += table-5-1 table-5-2 fig-5-19 fig-5-20

.PHONY: table-5-1 table-5-2 fig-5-19 fig-5-20
table-5-1: $(ELEVEN)/tables.md
	@sed -n '/^## Table 5.1/,/^## Table 5.2/p' $< | sed '$$d'
table-5-2: $(ELEVEN)/tables.md
	@sed -n '/^## Table 5.2/,$$p' $<
# Poses 11, 10, 7, 8, 9 are on a level; 1, 2, 7, 3, 6 are above one another.
fig-5-19: $(ELEVEN)/horizontal.html
fig-5-20: $(ELEVEN)/vertical.html

$(ELEVEN)/tour.csv: eleven.csv tour.py
	@mkdir -p $(@D)
	$(PYTHON) tour.py $< 0.5 2 > $@

# before: the controller believes in robot.toml; after: in what the measured poses told.
BELIEF_before := $(BELIEF)
BELIEF_after := $(ELEVEN)/corrected.toml

define eleven_run
$(ELEVEN)/$1.mcap: $(ELEVEN)/tour.csv $(BELIEF_$1) $(REAL) $(FRAME)
	simulate -q -f $(FRAME) --trajectory $$< --robot $(BELIEF_$1) --robot-real $(REAL) \
		--effects $(ELEVEN_EFFECTS) --seed $2 --truth $$(@:.mcap=.truth.csv) \
		--desired $$(@:.mcap=.desired.csv) --imu $$(@:.mcap=.imu.csv) --format mcap -o $$@

# All on: remissions, motion in hindsight, smoothed over the standing scans.
$(ELEVEN)/$1.csv: $(ELEVEN)/$1.mcap
	extract-lines -q -f $(FRAME) --smooth $$< \
		| solve-pose -q -f $(FRAME) --smooth --imu-pitch-sigma-deg 0 --imu $(ELEVEN)/$1.imu.csv \
			--format csv -o $$@

# As published: its lines, its vote.
$(ELEVEN)/$1-published.csv: $(ELEVEN)/$1.mcap
	extract-lines -q -f $(FRAME) --method dissertation $$< \
		| solve-pose -q -f $(FRAME) --method vote --imu-pitch-sigma-deg 0 --imu $(ELEVEN)/$1.imu.csv \
			--format csv -o $$@

$(ELEVEN)/$1%json: $(ELEVEN)/$1%csv
	report robot -q --robot $(BELIEF_$1) --desired $(ELEVEN)/$1.desired.csv --json $$< -o $$@
endef
$(eval $(call eleven_run,before,51))
$(eval $(call eleven_run,after,52))

$(ELEVEN)/corrected.toml: $(ELEVEN)/before.csv
	report robot -q --robot $(BELIEF) --desired $(ELEVEN)/before.desired.csv --corrected $@ $< \
		> $(ELEVEN)/before.txt

$(ELEVEN)/tables.md: eleven.py eleven.csv \
		$(foreach r,before before-published after after-published,$(ELEVEN)/$r.json)
	$(PYTHON) eleven.py $(ELEVEN) $(OUT) > $@

ELEVEN_ZONE_horizontal := z:1.745:1.755
ELEVEN_ZONE_vertical := |y|<0.05
define eleven_page
$(ELEVEN)/$1.html: $(ELEVEN)/before.csv $(ELEVEN)/after.csv $(ELEVEN)/tables.md
	report -q --desired $(ELEVEN)/before.desired.csv --zone '$1=$(ELEVEN_ZONE_$1)' \
		--title 'Eleven poses, $1: before and after the pulleys were calibrated' --html $$@ \
		before=$(ELEVEN)/before.csv after=$(ELEVEN)/after.csv > $$(@:.html=.txt)
endef
$(foreach p,horizontal vertical,$(eval $(call eleven_page,$p)))
