//! The completions in `completions/` offer what the tools take. They are made here from the tools'
//! own `Args`; `make completions` (`UPDATE_COMPLETIONS=1 cargo test --test completions`) rewrites
//! them.

mod shell;

use cablepose::tool;
use clap::{Command, CommandFactory};
use clap_complete::{Generator, Shell};
use shell::TOOLS;
use std::fs;
use std::path::{Path, PathBuf};

fn commands() -> Vec<Command> {
    vec![
        tool::scan_capture::Args::command(),
        tool::imu_read::Args::command(),
        tool::timesync::Args::command(),
        tool::simulate::Args::command(),
        tool::extract_lines::Args::command(),
        tool::solve_pose::Args::command(),
        tool::compensate_delay::Args::command(),
        tool::ads_push::Args::command(),
        tool::report::Args::command(),
    ]
}

/// A tool's script for a shell, and where it is kept.
fn script(mut command: Command, shell: Shell) -> (PathBuf, String) {
    let name = command.get_name().to_owned();
    // The file is named as the shell looks it up, but for bash, which drops an ending anyway.
    let (folder, file) = match shell {
        Shell::Bash => ("bash", name.clone()),
        _ => (
            if shell == Shell::Zsh { "zsh" } else { "fish" },
            shell.file_name(&name),
        ),
    };
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut command, name, &mut text);
    let lines = String::from_utf8(text).unwrap();
    let mut tidy: String = lines
        .lines()
        .map(|line| format!("{}\n", line.trim_end()))
        .collect();
    tidy.truncate(tidy.trim_end().len() + 1);
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("completions");
    (root.join(folder).join(file), tidy)
}

#[test]
fn completions_offer_what_the_tools_take() {
    let update = std::env::var_os("UPDATE_COMPLETIONS").is_some();
    let mut stale = Vec::new();
    for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
        for command in commands() {
            let (path, text) = script(command, shell);
            if update {
                fs::create_dir_all(path.parent().unwrap()).unwrap();
                fs::write(&path, &text).unwrap();
            } else if fs::read_to_string(&path).unwrap_or_default() != text {
                stale.push(path);
            }
        }
    }
    assert!(stale.is_empty(), "stale, run `make completions`: {stale:?}");
}

#[test]
fn every_tool_has_its_completions() {
    let names: Vec<String> = commands().iter().map(|c| c.get_name().to_owned()).collect();
    assert_eq!(names, TOOLS);
}

/// bash itself completes an option's name and an option's value.
#[test]
fn bash_completes() {
    let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("completions/bash");
    let ask = |script: &str, words: &[&str]| {
        let ask = format!(
            "source '{}/{script}'; COMP_WORDS=({}); COMP_CWORD={}; _{} {script} '{}' '{}'; \
             printf '%s\\n' \"${{COMPREPLY[@]}}\"",
            dir.display(),
            words.join(" "),
            words.len() - 1,
            script.replace('-', "__"),
            words[words.len() - 1],
            words[words.len() - 2],
        );
        let out = std::process::Command::new("bash")
            .args(["-c", &ask])
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert!(out.status.success(), "{said}");
        String::from_utf8(out.stdout).unwrap()
    };
    assert_eq!(
        ask("solve-pose", &["solve-pose", "--calib"]).lines().next(),
        Some("--calibrate")
    );
    assert_eq!(
        ask("solve-pose", &["solve-pose", "--method", "vo"]),
        "vote\n"
    );
    assert_eq!(ask("timesync", &["timesync", "tra"]), "track\n");
}
