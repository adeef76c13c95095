# cablepose: `make demo` shows what it does, `make test` shows that it works. `make help` lists all.

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DELETE_ON_ERROR:
.ONESHELL:
.DEFAULT_GOAL := help

CARGO ?= cargo
PYTHON ?= python3
PREFIX ?= /usr/local
DESTDIR ?=
INSTALL ?= install
TARGET := $(or $(CARGO_TARGET_DIR),target)

TOOLS := scan-capture imu-read timesync simulate extract-lines solve-pose compensate-delay ads-push report
FRAME := testdata/cablar.toml
DEMO := $(TARGET)/demo
# The grid of the workspace, 0.2 m apart, with noise, bias, quantisation and the beam's extent. The
# platform is at rest in every pose, which scan after scan looks like 7 m/s: --deskew none.
DEMO_RUN := --trajectory grid --step-m 0.2 --z-range 0.5,4 --effects reference
INTEROP := $(TARGET)/interop

## build: the nine programs, optimised, in target/release
.PHONY: build
build:
	$(CARGO) build --release --locked --bins

## demo: a simulated run through the pipes; prints the table, leaves target/demo/report.html
.PHONY: demo
demo: build
	@mkdir -p $(DEMO)
	export PATH="$(abspath $(TARGET))/release:$$PATH"
	echo "simulate | extract-lines | solve-pose | report"
	simulate -f $(FRAME) $(DEMO_RUN) --truth $(DEMO)/truth.csv \
		| tee $(DEMO)/scans.csv \
		| extract-lines -f $(FRAME) --deskew none \
		| tee $(DEMO)/lines.csv \
		| solve-pose -f $(FRAME) --pitch-deg 0 \
		| tee $(DEMO)/poses.csv \
		| report --truth $(DEMO)/truth.csv --html $(DEMO)/report.html -
	echo "look at $(DEMO)/report.html; scans.csv, lines.csv, poses.csv and truth.csv are beside it"

## test: every test
.PHONY: test
test:
	$(CARGO) test --locked

## check: format, lints, tests, documentation, man pages, lock file
.PHONY: check
check:
	$(CARGO) fmt --check
	$(CARGO) clippy --locked --all-targets -- -D warnings
	$(MAKE) test
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc --locked --no-deps

## fuzz: every parser on bytes that nobody would send, FUZZ_SECONDS=60 each; an error on a find (needs cargo-fuzz)
FUZZ_SECONDS ?= 60
.PHONY: fuzz
fuzz:
	@FUZZ_SECONDS=$(FUZZ_SECONDS) fuzz/run

## soak: a live chain under an hour's faults (5 minutes; SOAK_SECONDS, SOAK_SEED); an error where something is lost uncounted
SOAK_SECONDS ?= 300
SOAK_SEED ?= 1
.PHONY: soak
soak:
	CABLEPOSE_SOAK_S=$(SOAK_SECONDS) CABLEPOSE_SOAK_SEED=$(SOAK_SEED) $(CARGO) test --locked --test soak -- --nocapture

## man: rewrites man/*.1 from the tools' own help
.PHONY: man
man:
	UPDATE_MAN=1 $(CARGO) test --locked --test man

## golden: rewrites testdata/golden; look at the difference before committing it
.PHONY: golden
golden:
	SNAPSHOTS=overwrite $(CARGO) test --locked --test chain golden

## bench: scans a second through the chain on one core, then the library's own benchmarks
.PHONY: bench
bench: build
	@BIN=$(TARGET)/release OUT=$(TARGET)/bench FRAME=$(FRAME) benches/chain
	$(CARGO) bench --locked --bench streams --bench lines --bench decode

## lines-table: the dissertation's table of line extractors with ours beside it, and its modified Hough transform against the whole one
.PHONY: lines-table
lines-table:
	@$(CARGO) bench --locked --bench lines_table

## clock-table: errors of clock fits and trajectory delays on simulated runs, beside the goals (an error where one is missed)
.PHONY: clock-table
clock-table:
	@$(CARGO) bench --locked --bench clock

## clock-loopback: errors of clock fits against an emulated scanner on the loopback, idle and under load (4 minutes)
.PHONY: clock-loopback
clock-loopback:
	@$(CARGO) bench --locked --bench clock_loopback

## bench-ads: writes to an emulated PLC on the loopback: round trips, memory and bytes over a million writes (2 minutes)
.PHONY: bench-ads
bench-ads:
	@$(CARGO) bench --locked --bench ads

## bench-live: an emulated scanner on the loopback: how late its records and writes come, how many are lost (6 minutes; an error where a count is wrong)
.PHONY: bench-live
bench-live: build
	@$(CARGO) bench --locked --bench live

## interop: other people's MCAP readers (Python, from PyPI) read what these programs write
.PHONY: interop
interop:
	$(CARGO) build --locked --bins --examples
	test -x $(INTEROP)/venv/bin/python || $(PYTHON) -m venv $(INTEROP)/venv
	$(INTEROP)/venv/bin/pip install --quiet --disable-pip-version-check -r interop/requirements.txt
	BIN=$(TARGET)/debug PYTHON=$(INTEROP)/venv/bin/python OUT=$(INTEROP) FRAME=$(FRAME) interop/run

## experiments: the run matrix of experiments/Makefile
.PHONY: experiments
experiments: build
	$(MAKE) -C experiments BIN=$(abspath $(TARGET))/release OUT=$(abspath $(TARGET))/experiments

## accuracy: prints the figures of the table in the README (under a minute; an error where one is worse than promised)
.PHONY: accuracy
accuracy: build
	@$(MAKE) --no-print-directory -C experiments accuracy BIN=$(abspath $(TARGET))/release OUT=$(abspath $(TARGET))/experiments

## pose-table: errors of the pose in every case, beside goals and bounds (an error where one is missed); ONLY=text for some rows
.PHONY: pose-table
pose-table: build
	@mkdir -p $(TARGET)/experiments
	$(MAKE) --no-print-directory -C experiments pose-table BIN=$(abspath $(TARGET))/release OUT=$(abspath $(TARGET))/experiments

## delay-table: what carrying poses over 62 ms leaves of the error, beside the goals (an error where one is missed)
.PHONY: delay-table
delay-table:
	$(CARGO) bench --locked --bench compensate

## calibration-table: what a calibration from 600 scans leaves of a survey's errors, 8 campaigns a row, beside the goals
.PHONY: calibration-table
calibration-table:
	@$(CARGO) bench --locked --bench calibration

## strip-designs: inclination, width and spacing of the strips, predicted and by simulated scans
.PHONY: strip-designs
strip-designs: build
	@$(MAKE) --no-print-directory -C experiments strip-designs BIN=$(abspath $(TARGET))/release OUT=$(abspath $(TARGET))/experiments

## yaw-range: over which yaw the walls' reflectors are hit, eq. 3.104 beside scans
.PHONY: yaw-range
yaw-range: build
	@$(MAKE) --no-print-directory -C experiments yaw-range BIN=$(abspath $(TARGET))/release OUT=$(abspath $(TARGET))/experiments

## install: programs and man pages under PREFIX (/usr/local), below DESTDIR
.PHONY: install
install: build
	$(INSTALL) -d $(DESTDIR)$(PREFIX)/bin $(DESTDIR)$(PREFIX)/share/man/man1 $(DESTDIR)$(PREFIX)/share/man/man7
	$(INSTALL) -m 755 $(TOOLS:%=$(TARGET)/release/%) $(DESTDIR)$(PREFIX)/bin/
	$(INSTALL) -m 644 $(wildcard man/*.1) $(DESTDIR)$(PREFIX)/share/man/man1/
	$(INSTALL) -m 644 man/cablepose.7 $(DESTDIR)$(PREFIX)/share/man/man7/

## uninstall: removes what install put there
.PHONY: uninstall
uninstall:
	rm -f $(TOOLS:%=$(DESTDIR)$(PREFIX)/bin/%) $(patsubst man/%,$(DESTDIR)$(PREFIX)/share/man/man1/%,$(wildcard man/*.1)) \
		$(DESTDIR)$(PREFIX)/share/man/man7/cablepose.7

## clean: removes everything that was built
.PHONY: clean
clean:
	$(CARGO) clean

## help: this list
.PHONY: help
help:
	@sed -n 's/^## \([a-z-]*\): */\1\t/p' Makefile | while IFS=$$'\t' read -r target what; do
		printf '  make %-15s %s\n' "$$target" "$$what"
	done
