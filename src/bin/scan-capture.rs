//! `scan-capture`: scans from a SICK laser scanner. See [`cablepose::tool::scan_capture`].

fn main() -> std::process::ExitCode {
    cablepose::tool::main("scan-capture", cablepose::tool::scan_capture::run)
}
