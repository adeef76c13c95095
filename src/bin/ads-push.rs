//! `ads-push`: see [`cablepose::tool::ads_push`].

fn main() -> std::process::ExitCode {
    cablepose::tool::main("ads-push", cablepose::tool::ads_push::run)
}
