//! extract-lines: straight lines and strip edges from scans.

fn main() -> std::process::ExitCode {
    cablepose::tool::main("extract-lines", cablepose::tool::extract_lines::run)
}
