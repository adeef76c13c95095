//! A session with a real LMS511, asked again.

use super::*;

#[test]
fn a_recorded_session_is_answered_as_the_recorded_lms511_did() {
    let Some(data) = recordings() else {
        return;
    };
    let bodies = |name: &str| {
        let bytes = std::fs::read(data.join(name)).unwrap();
        let mut framer = Framer::new();
        framer.feed(&bytes);
        framer.end();
        let mut bodies = Vec::new();
        while let Some(event) = framer.next() {
            if let Event::Telegram(telegram) = event {
                bodies.push(telegram.body.to_vec());
            }
        }
        bodies
    };
    let requests = bodies("20210302_lms511.host.cola");
    let recorded = bodies("20210302_lms511.cola");
    let is_event = |body: &&Vec<u8>| body.starts_with(b"sSN ");
    let due: Vec<_> = recorded.iter().filter(|body| !is_event(body)).collect();
    assert_eq!((requests.len(), due.len()), (49, 49));
    let mut bench = Bench::lms();
    bench.dialect = Dialect::Binary;
    bench.now_ns = 3_000_000_000;
    let mut events = 0;
    for (request, due) in requests.iter().zip(due) {
        let mut answers = bench.send(request);
        let name = String::from_utf8_lossy(request).into_owned();
        events += answers.len() - 1;
        let answer = answers.remove(0);
        let is_defined = |n: u32| name == format!("sRN field{n:03}");
        if (0..10).any(is_defined) {
            // That unit had fields defined; this one has none.
            assert_eq!(answer.get(..13), due.get(..13), "{name}");
        } else if name == "sRN LIDinputstate" {
            // Counter and calendar are those of the last change: on the recorded unit 2.7 s after
            // power-on, here power-on itself. The date is that of an unset clock.
            assert_eq!(
                (answer.len(), &answer[..20]),
                (due.len(), &due[..20]),
                "{name}"
            );
            assert_eq!(answer[20..24], [0; 4], "{name}");
            assert_eq!(answer[24..36], due[24..36], "{name}");
            assert_eq!(answer[36..], [0; 5], "{name}");
        } else {
            assert_eq!(&answer, due, "{name}");
        }
    }
    // Two events came with the subscription, of the recorded length.
    let event = recorded
        .iter()
        .find(|body| body.starts_with(b"sSN LIDoutputstate"));
    assert_eq!(events, 2);
    let ours = bench.send(b"sEN LIDoutputstate \x01");
    assert_eq!(ours[1].len(), event.unwrap().len());
    assert_eq!(ours[1][..20], event.unwrap()[..20]);
    // The scans have the recorded length and layout.
    let theirs = recorded
        .iter()
        .find(|body| body.starts_with(b"sSN LMDscandata"));
    let telegram = Telegram {
        dialect: Dialect::Binary,
        offset: 0,
        body: theirs.unwrap(),
    };
    let mut theirs = LmdScandata::default();
    theirs.parse(&telegram).unwrap();
    let (_, ours) = bench.wait(200).pop().unwrap();
    let shape = |scan: &LmdScandata| {
        let channels = scan.channels.iter();
        let channels: Vec<_> = channels
            .map(|c| {
                (
                    c.name,
                    c.width,
                    c.scale,
                    c.start_angle,
                    c.angular_step,
                    c.values.len(),
                )
            })
            .collect();
        let fixed = (
            scan.version,
            scan.device_number,
            scan.serial_number,
            scan.outputs,
        );
        let rates = (scan.scan_frequency, scan.measurement_frequency);
        (
            channels,
            fixed,
            rates,
            scan.time.is_some(),
            scan.encoders.len(),
        )
    };
    assert_eq!(shape(&ours), shape(&theirs));
}

#[test]
fn a_recording_of_a_part_of_the_aperture_reads_back_as_that_part() {
    let mut bench = Bench::logged_in();
    bench.ask("sWN LMPoutputRange 1 683 +0 +900000");
    bench.ask("sMN Run");
    bench.ask("sEN LMDscandata 1");
    let mut bytes = Vec::new();
    for (_, scan) in bench.wait(500) {
        encode(&scan, Dialect::Binary, &mut bytes);
    }
    let recording = recording::Recording::new(&bytes, behaviour().model, None).unwrap();
    let mut device = Emulator::new(behaviour(), recording);
    device.connected(1, 0, 0);
    let mut out = Outbox::default();
    device.advance(0, &mut out);
    let mut ask = |text: &str| {
        let mut request = Vec::new();
        frame(Dialect::Text, text.as_bytes(), &mut request);
        device.input(1, &request, 0, &mut out);
        String::from_utf8(body_of(&out.take()[0].2)).unwrap()
    };
    let part = "sRA LMPoutputRange 1 683 0 DBBA0";
    assert_eq!(ask("sRN LMPoutputRange"), part);
    ask("sMN SetAccessMode 3 F4724744");
    // What it never saw cannot be sent.
    assert_eq!(
        ask("sWN LMPoutputRange 1 683 -50000 +1850000"),
        "sWA LMPoutputRange"
    );
    assert_eq!(ask("sRN LMPoutputRange"), part);
    assert_eq!(ask("sWN LMPoutputRange 1 683 +900000 +1350000"), "sFA 4");
    ask("sWN LMPoutputRange 1 683 +450000 +1350000");
    assert_eq!(
        ask("sRN LMPoutputRange"),
        "sRA LMPoutputRange 1 683 6DDD0 DBBA0"
    );
    assert_eq!(ask("sMN mSCloadfacdef"), "sAN mSCloadfacdef 1");
    assert_eq!(ask("sRN LMPoutputRange"), part);
}

/// Where recordings of real devices are; none, and it is said, where they are not.
fn recordings() -> Option<PathBuf> {
    let beside = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let data = std::env::var_os("CABLEPOSE_DATA").map_or(beside, PathBuf::from);
    let data = data.join("lms5xx");
    if data.join("20210302_lms511.cola").exists() {
        return Some(data);
    }
    println!("skipped: no recordings in {}", data.display());
    None
}
