//! report: error statistics of poses against a true or desired trajectory.

fn main() -> std::process::ExitCode {
    cablepose::tool::main("report", cablepose::tool::report::run)
}
