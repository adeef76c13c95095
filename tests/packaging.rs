//! What `packaging/` holds works: the service's chain runs against emulated devices, ends in good
//! order on SIGTERM, and refuses what makes no sense.

mod shell;

use shell::{scratch, sh};
use std::fs;
use std::path::Path;

/// The service's script.
fn live() -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    root.join("packaging/systemd/live").display().to_string()
}

#[test]
fn the_service_runs_the_chain_and_ends_on_sigterm() {
    let dir = scratch("packaging-live");
    let devices = "simulate -q -f frame.toml --trajectory loop --loops 1000 --serve 127.0.0.1:0 \
                   --imu-pty imu --hold --linger 200ms";
    // The emulated scanner says where it listens; the chain ends when it is told to, with poses kept.
    let script = format!(
        "{devices} 2> devices.log & devices=$!
         until [[ -e imu ]] && grep -q 127.0.0.1: devices.log; do sleep 0.1; done
         export SCANNER=$(grep -o '127.0.0.1:[0-9]*' devices.log | head -1) IMU=$PWD/imu
         export FRAME=$PWD/frame.toml SOLVE_POSE_OPTIONS='--imu-wait 2s'
         '{}' 2> live.log & chain=$!
         for _ in $(seq 600); do
             [[ $(cat pose-*.csv 2>/dev/null | wc -l) -gt 5 ]] && break
             sleep 0.1
         done
         kill -TERM $chain
         wait $chain; echo chain $?
         kill $devices; wait $devices || true",
        live()
    );
    let ended = sh(&dir, &script);
    let said = fs::read_to_string(dir.join("live.log")).unwrap();
    assert_eq!(ended.text(), "chain 0\n", "{said}{}", ended.stderr);
    let kept: Vec<_> = fs::read_dir(&dir)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "csv"))
        .collect();
    assert_eq!(kept.len(), 1, "{kept:?}");
    let poses = fs::read_to_string(&kept[0]).unwrap();
    assert!(poses.lines().count() > 5 && poses.ends_with('\n'), "{said}");
}

#[test]
fn the_service_says_what_is_not_set() {
    let dir = scratch("packaging-unset");
    let ended = sh(&dir, &format!("FRAME=frame.toml '{}'", live()));
    assert!(ended.status != 0 && ended.stderr.contains("SCANNER: is not set"));
    let ended = sh(
        &dir,
        &format!(
            "FRAME=frame.toml SCANNER=127.0.0.1:1 TARGET=127.0.0.1.1.1 '{}'",
            live()
        ),
    );
    assert_eq!(ended.status, 78, "{}", ended.stderr);
    assert!(ended.stderr.contains("VARIABLE is not"));
}

/// Every variable of the sample environment is one that the script reads, and the other way round.
#[test]
fn the_sample_environment_is_complete() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("packaging/systemd");
    let script = fs::read_to_string(root.join("live")).unwrap();
    let sample = fs::read_to_string(root.join("live.env")).unwrap();
    let mut set: Vec<&str> = sample
        .lines()
        .filter(|line| !line.starts_with('#'))
        .filter_map(|line| Some(line.split_once('=')?.0))
        .collect();
    let mut read: Vec<&str> = script
        .split("${")
        .skip(1)
        .filter_map(|rest| rest.split_once(":").map(|(name, _)| name))
        .filter(|name| name.chars().all(|c| c.is_ascii_uppercase() || c == '_'))
        .collect();
    set.sort();
    read.sort();
    read.dedup();
    assert_eq!(set, read);
}
