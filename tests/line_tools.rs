//! Lines through the pipes: an office and its true lines, their scores, and the dissertation's way
//! from scans to poses.

mod shell;

use shell::{scratch, sh};

#[test]
fn an_office_is_the_same_every_time() {
    let dir = scratch("line-tools-office");
    for (name, seed) in [("a", 3), ("b", 3), ("c", 4)] {
        let command = format!(
            "simulate --scene office --view half --n-scans 4 --seed {seed} --truth {name}.true.csv \
             > {name}.csv"
        );
        sh(&dir, &command).expect(0);
    }
    sh(&dir, "cmp a.csv b.csv && cmp a.true.csv b.true.csv").expect(0);
    sh(&dir, "cmp -s a.csv c.csv").expect(1);
    // MCAP holds the same.
    let mcap = "simulate --scene office --view half --n-scans 4 --seed 3 --format mcap -o a.mcap \
                && extract-lines a.mcap --format csv > m.csv && extract-lines a.csv > s.csv \
                && cmp m.csv s.csv";
    sh(&dir, mcap).expect(0);
}

#[test]
fn the_chain_from_office_to_score_keeps_its_gates() {
    let dir = scratch("line-tools-score");
    sh(
        &dir,
        "simulate --scene office --n-scans 15 --truth true.csv > office.csv",
    )
    .expect(0);
    for method in ["ransac", "hough", "split-and-merge"] {
        let command = format!(
            "extract-lines --method {method} --sigma-mm 15 office.csv | report lines --truth true.csv \
             --fail-if 'truepos_pct<75' --fail-if 'falsepos_pct>10' --fail-if 'alpha.std_deg>0.8'"
        );
        let ended = sh(&dir, &command);
        assert_eq!(
            ended.status,
            0,
            "{method}: {} {}",
            ended.text(),
            ended.stderr
        );
        assert!(ended.text().contains("TruePos"), "{}", ended.text());
    }
    // The truth against itself; side by side in JSON.
    let json = sh(&dir, "report lines --truth true.csv all=true.csv --json").expect(0);
    let value: serde_json::Value = serde_json::from_str(json.text()).unwrap();
    assert_eq!(value["runs"][0]["truepos_pct"], 100.0);
    assert_eq!(value["runs"][0]["falsepos_pct"], 0.0);
    let gate = sh(
        &dir,
        "report lines --truth true.csv true.csv --fail-if 'truepos_pct>99'",
    );
    assert_eq!(gate.status, 4, "{}", gate.stderr);
    let nothing = sh(&dir, "head -n 1 true.csv | report lines --truth true.csv");
    assert_eq!(nothing.status, 3, "{}", nothing.stderr);
}

#[test]
fn poses_are_reported_as_ever_beside_the_subcommands() {
    let dir = scratch("line-tools-report");
    let run = "simulate -f frame.toml --effects none --n-scans 20 --truth truth.csv \
               | extract-lines -f frame.toml | solve-pose -f frame.toml > lines.csv";
    sh(&dir, run).expect(0);
    sh(&dir, "report --truth truth.csv ./lines.csv").expect(0);
    sh(&dir, "report lines").expect(2);
    sh(
        &dir,
        "report lines --truth truth.csv --fail-if 'x.rms_mm>1'",
    )
    .expect(2);
}

#[test]
fn what_has_no_effect_is_refused() {
    let dir = scratch("line-tools-refused");
    for (command, word) in [
        ("simulate --scene office --step-m 2", "--step-m"),
        ("simulate --scene office -f frame.toml", "--frame"),
        ("simulate --scene office --effects none", "--effects"),
        ("simulate -f frame.toml --view half", "--scene"),
        ("simulate --scene harbour", "harbour"),
        ("extract-lines --method dissertation", "-f FILE"),
        ("extract-lines --method ransac --predict a.csv", "--predict"),
        (
            "extract-lines --method dissertation -f frame.toml --sigma-mm 5",
            "--sigma-mm",
        ),
    ] {
        let ended = sh(&dir, &format!("{command} < /dev/null"));
        assert_eq!(ended.status, 2, "{command}: {}", ended.stderr);
        assert!(ended.stderr.contains(word), "{command}: {}", ended.stderr);
    }
}

/// Exact scans, then with noise: the three lines, the strips' ends, and the vote over them.
#[test]
fn the_dissertations_way_leads_to_poses() {
    let dir = scratch("line-tools-dissertation");
    for (effects, mm, x_mm, yaw_deg) in [("none", 0.1, 12.0, 0.3), ("noise", 3.0, 20.0, 0.5)] {
        let simulate = format!(
            "simulate -f frame.toml --effects {effects} --trajectory loop --truth truth.csv > scans.csv"
        );
        sh(&dir, &simulate).expect(0);
        for method in ["dissertation", "modified-hough"] {
            let chain = format!(
                "extract-lines -f frame.toml --method {method} scans.csv > {method}.csv \
                 && solve-pose -f frame.toml --method vote --pitch-deg 0 {method}.csv > poses.csv \
                 ; report --truth truth.csv poses.csv --fail-if 'scans.solved_pct<90' \
                 --fail-if 'y.rms_mm>{mm}' --fail-if 'z.rms_mm>{mm}' --fail-if 'x.rms_mm>{x_mm}' \
                 --fail-if 'yaw.rms_deg>{yaw_deg}'"
            );
            let ended = sh(&dir, &chain);
            assert_eq!(
                ended.status,
                0,
                "{effects} {method}: {}\n{}",
                ended.stderr,
                ended.text()
            );
        }
    }
    // Told where the lines are, the first scan is found as the others are.
    let told = "head -n 2 dissertation.csv > home.csv && head -n 3 scans.csv \
                | extract-lines -f frame.toml --method dissertation --predict home.csv > told.csv \
                && cmp told.csv <(head -n 3 dissertation.csv)";
    sh(&dir, told).expect(0);
}

#[test]
fn a_frame_file_may_be_a_pipe() {
    let dir = scratch("line-tools-frame-pipe");
    let command = "simulate -f frame.toml --n-scans 2 > scans.csv \
                   && extract-lines -f frame.toml --format mcap scans.csv > file.mcap \
                   && extract-lines -f <(cat frame.toml) --format mcap scans.csv > pipe.mcap";
    sh(&dir, command).expect(0);
    // The frame goes on with the lines in either case.
    for name in ["file", "pipe"] {
        let bytes = std::fs::read(dir.join(format!("{name}.mcap"))).unwrap();
        let held = bytes.windows(6).any(|bytes| bytes == b"[box]\n");
        assert!(held, "{name}");
    }
}
