//! `timesync`: see [`cablepose::tool::timesync`].

fn main() -> std::process::ExitCode {
    cablepose::tool::main("timesync", cablepose::tool::timesync::run)
}
