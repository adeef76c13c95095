# Filter and smoother over many short runs, beside their goals; ends with an error where one is missed.
.PHONY: filter-table
filter-table:
	@cd .. && $(PYTHON) experiments/pose_table.py experiments/filter-table.toml \
		$(abspath $(OUT))/filter --only '$(ONLY)' --markdown $(abspath $(OUT))/filter-table.md
