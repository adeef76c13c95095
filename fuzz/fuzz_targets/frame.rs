//! Any text as a frame file: it is refused or makes a frame whose geometry can be worked with, and
//! a calibration that is put into the text is what the text then says. And as a robot file: refused,
//! or a robot whose cables have lengths.
#![no_main]

use cablepose::frame::{Frame, ScannerPose, edit};
use cablepose::record::Face;
use cablepose::robot::{Pose, Robot};
use cablepose_fuzz::bounded;
use libfuzzer_sys::fuzz_target;
use std::path::Path;

fuzz_target!(|data: &[u8]| {
    let Ok(text) = std::str::from_utf8(data) else {
        return;
    };
    let path = Path::new("frame.toml");
    let limit = (4 << 20) + 1024 * text.len() as u64;
    if let Ok(robot) = bounded(limit, || Robot::parse(text, path)) {
        let pose = Pose::new(0.1, -1.0, 2.0, 0.05, -0.1, 0.2);
        if let Ok(lengths_m) = robot.lengths(&pose) {
            assert_eq!(lengths_m.len(), robot.cables.len());
            let _ = robot.forward(&lengths_m, &pose);
        }
        let _ = robot.groups();
    }
    let Ok(frame) = bounded(limit, || Frame::parse(text, path)) else {
        return;
    };
    for pose in [[0.0; 3], [0.1, -1.0, 2.0], [-5.0, 40.0, 1e6]] {
        let scanner = ScannerPose::new(&frame, pose, [0.05, -0.1, 0.2]);
        for face in [Face::Right, Face::Upper, Face::Left] {
            let _ = scanner.line(face);
            for beam in -10..=370 {
                let _ = scanner.crossing(f64::from(beam).to_radians() / 2.0, face);
            }
        }
    }
    for (table, key) in [("calibration", "range_bias_m"), ("strip[0]", "offset_m")] {
        if let Ok(edited) = edit::set(text, table, key, "0.001", Some("fuzz")) {
            let again = Frame::parse(&edited, path);
            match (table, again) {
                ("calibration", again) => assert_eq!(again.unwrap().calibration.range_bias_m, 0.001),
                // A strip that moves may leave the face.
                (_, Ok(again)) => assert_eq!(again.strips[0].offset_m, 0.001),
                (_, Err(_)) => {}
            }
        }
    }
});
