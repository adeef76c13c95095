//! What the program is made of: every package comes from crates.io under a licence of deny.toml's
//! list. `cargo deny` says more, where it is installed; this runs everywhere.

#![cfg(target_os = "linux")]

use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// Whether an SPDX expression can be met with licences of a list. `/` is an old spelling of OR.
fn allows(list: &[&str], expression: &str) -> bool {
    let spaced = expression
        .replace('/', " OR ")
        .replace('(', " ( ")
        .replace(')', " ) ");
    let words: Vec<&str> = spaced.split_whitespace().collect();
    let mut rest = &words[..];
    let allowed = any(list, &mut rest);
    allowed && rest.is_empty()
}

fn any(list: &[&str], rest: &mut &[&str]) -> bool {
    let mut allowed = all(list, rest);
    while rest.first() == Some(&"OR") {
        *rest = &rest[1..];
        allowed |= all(list, rest);
    }
    allowed
}

fn all(list: &[&str], rest: &mut &[&str]) -> bool {
    let mut allowed = one(list, rest);
    while rest.first() == Some(&"AND") {
        *rest = &rest[1..];
        allowed &= one(list, rest);
    }
    allowed
}

fn one(list: &[&str], rest: &mut &[&str]) -> bool {
    let Some((first, behind)) = rest.split_first() else {
        return false;
    };
    *rest = behind;
    if *first == "(" {
        let allowed = any(list, rest);
        let closed = rest.first() == Some(&")");
        *rest = rest.get(1..).unwrap_or_default();
        return allowed && closed;
    }
    // An exception only adds to what a licence allows.
    if rest.first() == Some(&"WITH") {
        *rest = rest.get(2..).unwrap_or_default();
    }
    list.contains(first)
}

#[test]
fn expressions_are_understood() {
    let list = ["MIT", "Apache-2.0", "Unicode-3.0"];
    for (expression, allowed) in [
        ("MIT", true),
        ("MIT/Apache-2.0", true),
        ("GPL-3.0 OR MIT", true),
        ("GPL-3.0-only", false),
        ("(MIT OR Apache-2.0) AND Unicode-3.0", true),
        ("(MIT OR Apache-2.0) AND NCSA", false),
        ("MIT AND (GPL-2.0 OR BSL-1.0)", false),
        ("Apache-2.0 WITH LLVM-exception OR GPL-2.0", true),
        ("MIT Apache-2.0", false),
        ("(MIT", false),
        ("", false),
    ] {
        assert_eq!(allows(&list, expression), allowed, "{expression}");
    }
}

#[test]
fn every_package_has_a_known_source_and_licence() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let cargo = std::env::var_os("CARGO").unwrap_or("cargo".into());
    // Without a network: what was built is here.
    let target = format!("{}-unknown-linux-gnu", std::env::consts::ARCH);
    let output = Command::new(cargo)
        .current_dir(root)
        .args(["metadata", "--format-version", "1", "--locked", "--offline"])
        .args(["--filter-platform", &target])
        .output()
        .unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{stderr}");
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    let deny = std::fs::read_to_string(root.join("deny.toml")).unwrap();
    let deny: toml::Table = deny.parse().unwrap();
    let list: Vec<&str> = deny["licenses"]["allow"]
        .as_array()
        .unwrap()
        .iter()
        .map(|licence| licence.as_str().unwrap())
        .collect();
    let packages = metadata["packages"].as_array().unwrap();
    assert!(packages.len() > 50, "{}", packages.len());
    for package in packages {
        let name = package["name"].as_str().unwrap();
        let licence = package["license"].as_str().unwrap_or("");
        assert!(allows(&list, licence), "{name}: licence {licence:?}");
        let source = package["source"].as_str();
        let own = source.is_none() && name == "cablepose";
        let registry = "registry+https://github.com/rust-lang/crates.io-index";
        assert!(own || source == Some(registry), "{name}: source {source:?}");
    }
}
