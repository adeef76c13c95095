//! `compensate-delay`: see [`cablepose::tool::compensate_delay`].

fn main() -> std::process::ExitCode {
    cablepose::tool::main("compensate-delay", cablepose::tool::compensate_delay::run)
}
