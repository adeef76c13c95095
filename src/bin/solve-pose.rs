//! solve-pose: reflector lines in, poses out.

fn main() -> std::process::ExitCode {
    cablepose::tool::main("solve-pose", cablepose::tool::solve_pose::run)
}
