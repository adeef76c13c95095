//! `simulate`: a virtual frame, scanner, IMU and trajectory.

fn main() -> std::process::ExitCode {
    cablepose::tool::main("simulate", cablepose::tool::simulate::run)
}
