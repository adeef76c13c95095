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

## pictures: draws docs/frame.svg and docs/scan.svg, which the README shows, anew
PICTURES := $(TARGET)/pictures
.PHONY: pictures
pictures: build
	@mkdir -p $(PICTURES)
	export PATH="$(abspath $(TARGET))/release:$$PATH"
	simulate -q -f $(FRAME) --effects reference --trajectory random --n-scans 4 --imu $(PICTURES)/imu.csv -o $(PICTURES)/scans.csv
	extract-lines -q -f $(FRAME) -o $(PICTURES)/lines.csv $(PICTURES)/scans.csv
	solve-pose -q -f $(FRAME) --imu $(PICTURES)/imu.csv -o $(PICTURES)/poses.csv $(PICTURES)/lines.csv
	report frame --svg $(PICTURES) -o $(PICTURES)/frame.txt $(FRAME)
	report scan --lines $(PICTURES)/lines.csv -f $(FRAME) --poses $(PICTURES)/poses.csv --svg $(PICTURES) \
		-o $(PICTURES)/scan.txt $(PICTURES)/scans.csv
	cp $(PICTURES)/front.svg docs/frame.svg
	cp $(PICTURES)/scan.svg docs/scan.svg

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

## check-windows: the compiler's and the linter's word on the library and the programs for Windows (needs that target of rustup, and mingw-w64's gcc)
WINDOWS := x86_64-pc-windows-gnu
.PHONY: check-windows
check-windows:
	$(CARGO) clippy --locked --target $(WINDOWS) --lib --bins -- -D warnings

## man: rewrites man/*.1 from the tools' own help
.PHONY: man
man:
	UPDATE_MAN=1 $(CARGO) test --locked --test man

## completions: rewrites completions/* from the tools' own options
.PHONY: completions
completions:
	UPDATE_COMPLETIONS=1 $(CARGO) test --locked --test completions

## golden: rewrites testdata/golden; look at the difference before committing it
.PHONY: golden
golden:
	SNAPSHOTS=overwrite $(CARGO) test --locked --test chain golden

## bench: scans a second through the chain on one core, then the library's own benchmarks
.PHONY: bench
bench: build
	@BIN=$(TARGET)/release OUT=$(TARGET)/bench FRAME=$(FRAME) benches/chain
	@BIN=$(TARGET)/release OUT=$(TARGET)/bench FRAME=$(FRAME) $(PYTHON) benches/report
	$(CARGO) bench --locked --bench streams --bench lines --bench decode --bench simulate

## bench-memory: memory of a chain while ten million scans pass, SCANS=10000000 (10 minutes)
.PHONY: bench-memory
bench-memory: build
	@BIN=$(TARGET)/release FRAME=$(FRAME) $(PYTHON) benches/memory

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

## experiments: the dissertation's figures and tables redone, and beyond; -j uses all cores (summary.md in target/experiments)
.PHONY: experiments
experiments: build
	$(MAKE) -C experiments BIN=$(abspath $(TARGET))/release OUT=$(abspath $(TARGET))/experiments

# The rows of the README's first table, of those that `make experiments` leaves.
HEADLINE := fig-5-5 fig-5-6 fig-5-7 fig-5-8 fig-5-10 fig-5-13 strip-designs ablation

## headline: puts the experiments' figures into the README
.PHONY: headline
headline:
	@$(PYTHON) experiments/headline.py README.md $(TARGET)/experiments $(HEADLINE)

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

# What `make install` puts where; `make uninstall` takes the same list away.
BINDIR = $(DESTDIR)$(PREFIX)/bin
SHAREDIR = $(DESTDIR)$(PREFIX)/share
LIBDIR = $(DESTDIR)$(PREFIX)/lib
MANUALS := $(wildcard man/*.[157])
COMPLETIONS := $(wildcard completions/*/*)
EXAMPLES := testdata/cablar.toml testdata/inclined.toml packaging/systemd/live.env packaging/twincat/FB_CablePose.st

define INSTALLED
$(TOOLS:%=$(BINDIR)/%) \
$(foreach page,$(MANUALS),$(SHAREDIR)/man/man$(patsubst .%,%,$(suffix $(page)))/$(notdir $(page))) \
$(patsubst completions/bash/%,$(SHAREDIR)/bash-completion/completions/%,$(filter completions/bash/%,$(COMPLETIONS))) \
$(patsubst completions/zsh/%,$(SHAREDIR)/zsh/site-functions/%,$(filter completions/zsh/%,$(COMPLETIONS))) \
$(patsubst completions/fish/%,$(SHAREDIR)/fish/vendor_completions.d/%,$(filter completions/fish/%,$(COMPLETIONS))) \
$(addprefix $(SHAREDIR)/doc/cablepose/,README.md CHANGELOG.md packaging.md) \
$(addprefix $(SHAREDIR)/doc/cablepose/examples/,$(notdir $(EXAMPLES))) \
$(LIBDIR)/cablepose/live $(LIBDIR)/systemd/system/cablepose.service \
$(LIBDIR)/udev/rules.d/60-cablepose.rules
endef

## install: programs, manuals, completions, examples, unit and rules under PREFIX (/usr/local), below DESTDIR
.PHONY: install
install: build
	for page in $(MANUALS); do
		$(INSTALL) -D -m 644 $$page "$(SHAREDIR)/man/man$${page##*.}/$${page##*/}"
	done
	for program in $(TOOLS); do
		$(INSTALL) -D -m 755 $(TARGET)/release/$$program "$(BINDIR)/$$program"
	done
	$(INSTALL) -D -m 644 -t "$(SHAREDIR)/bash-completion/completions" completions/bash/*
	$(INSTALL) -D -m 644 -t "$(SHAREDIR)/zsh/site-functions" completions/zsh/*
	$(INSTALL) -D -m 644 -t "$(SHAREDIR)/fish/vendor_completions.d" completions/fish/*
	$(INSTALL) -D -m 644 -t "$(SHAREDIR)/doc/cablepose" README.md CHANGELOG.md
	$(INSTALL) -D -m 644 packaging/README.md "$(SHAREDIR)/doc/cablepose/packaging.md"
	$(INSTALL) -D -m 644 -t "$(SHAREDIR)/doc/cablepose/examples" $(EXAMPLES)
	$(INSTALL) -D -m 755 packaging/systemd/live "$(LIBDIR)/cablepose/live"
	sed 's|/usr/lib/cablepose|$(PREFIX)/lib/cablepose|; s|/usr/share|$(PREFIX)/share|' packaging/systemd/cablepose.service \
		| $(INSTALL) -D -m 644 /dev/stdin "$(LIBDIR)/systemd/system/cablepose.service"
	$(INSTALL) -D -m 644 -t "$(LIBDIR)/udev/rules.d" packaging/udev/60-cablepose.rules

## uninstall: removes what install put there
.PHONY: uninstall
uninstall:
	rm -f $(INSTALLED)
	-rmdir "$(SHAREDIR)/doc/cablepose/examples" "$(SHAREDIR)/doc/cablepose" "$(LIBDIR)/cablepose" 2>/dev/null

## check-install: installs into target/install, looks for each file and page there, and uninstalls
.PHONY: check-install
check-install: build
	rm -rf $(TARGET)/install
	$(MAKE) --no-print-directory install DESTDIR=$(abspath $(TARGET))/install PREFIX=/usr >/dev/null
	packaging/check-install $(abspath $(TARGET))/install
	$(MAKE) --no-print-directory uninstall DESTDIR=$(abspath $(TARGET))/install PREFIX=/usr
	left=$$(find $(TARGET)/install -type f)
	if [[ -n $$left ]]; then echo "left behind: $$left" >&2; exit 1; fi
	echo "installs and uninstalls"

## deb: a Debian package in target/debian (needs dpkg-deb)
.PHONY: deb
deb: build
	rm -rf $(TARGET)/debian/stage
	$(MAKE) --no-print-directory install DESTDIR=$(abspath $(TARGET))/debian/stage PREFIX=/usr >/dev/null
	STAGE=$(abspath $(TARGET))/debian/stage OUT=$(TARGET)/debian packaging/debian/build

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
