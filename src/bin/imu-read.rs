//! `imu-read`: see [`cablepose::tool::imu_read`].

fn main() -> std::process::ExitCode {
    cablepose::tool::main("imu-read", cablepose::tool::imu_read::run)
}
