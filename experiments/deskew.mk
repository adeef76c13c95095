# Motion inside the scan: nothing done about it, the published correction of beam lengths
# (Kurniawan 2017, eq. 3.22 to 3.29), the exact correction of points with the true motion, and the
# same with the motion that the scans show themselves. `make deskew` prints the errors below and
# above z = 2.74 m, beyond which the dissertation advises not to compensate for the velocity
# (section 5.1). That advice comes of the correction: beam lengths make it worse there than nothing
# at all, points better.

DESKEW := $(OUT)/deskew
DESKEW_HOW := none beam-length points self
# Hundred metres of diagonal at up to 3 m/s.
DESKEW_RUN ?= --trajectory loop --speed-m-s 3 --loops 10 --dwell 0ms --effects reference,motion

OPTIONS_none := --deskew none
OPTIONS_beam-length = --motion $(DESKEW)/truth.csv --deskew-method beam-length
OPTIONS_points = --motion $(DESKEW)/truth.csv
OPTIONS_self := --deskew self

.PHONY: deskew
deskew: $(DESKEW)/joint.txt $(DESKEW)/vote.txt
	@tail -n +1 $^

$(DESKEW)/scans.csv: $(FRAME)
	@mkdir -p $(@D)
	simulate -q -f $(FRAME) $(DESKEW_RUN) --truth $(@D)/truth.csv --imu $(@D)/imu.csv -o $@

$(DESKEW)/%.lines.csv: $(DESKEW)/scans.csv
	extract-lines -q -f $(FRAME) $(OPTIONS_$*) -o $@ $<

define deskew_solve
$(DESKEW)/$1-%.csv: $(DESKEW)/%.lines.csv
	solve-pose -q -f $(FRAME) --method $1 --imu $(DESKEW)/imu.csv --imu-pitch-sigma-deg 0 -o $$@ $$<

$(DESKEW)/$1.txt: $(DESKEW_HOW:%=$(DESKEW)/$1-%.csv)
	for zone in 'below=z<=2.74' 'above=z>2.74'; do \
		report -q --truth $(DESKEW)/truth.csv --zone "$$$$zone" $$^ | sed -n '/^side by side/,$$$$p'; \
	done > $$@
endef
$(foreach m,joint vote,$(eval $(call deskew_solve,$m)))
