//! What was sent, what came, what was lost.

use crate::Failure;
use crate::capture::{Capture, Captured, Format};
use crate::relay::{Pieces, Relay};
use crate::scanner::{Scanner, number_before};

/// A run: its scans, the emulator's options, and into pieces of how many bytes a relay gathers.
struct Run {
    name: &'static str,
    scans: u64,
    more: &'static [&'static str],
    gathered: Option<usize>,
}

const fn run(
    name: &'static str,
    scans: u64,
    more: &'static [&'static str],
    gathered: Option<usize>,
) -> Run {
    Run {
        name,
        scans,
        more,
        gathered,
    }
}

/// A telegram has 2.4 kB, so that the emulator's own pieces get no larger; those of 64 KiB are
/// gathered on the way.
const RUNS: [Run; 7] = [
    run("1 byte", 5_000, &["--faults", "garbage=0.3,chunk=1"], None),
    run(
        "1 to 99 bytes",
        15_000,
        &["--faults", "garbage=0.3,chunk=1..99"],
        None,
    ),
    run(
        "1 to 1448 bytes",
        30_000,
        &["--faults", "garbage=0.3,chunk=1..1448"],
        None,
    ),
    run(
        "1 to 65536 bytes",
        20_000,
        &["--faults", "garbage=0.3,chunk=1..65536"],
        None,
    ),
    run(
        "65536 bytes",
        30_000,
        &["--faults", "garbage=0.3"],
        Some(1 << 16),
    ),
    run(
        "1 to 1448 bytes, damaged",
        20_000,
        &[
            "--faults",
            "drop=0.01,flip=0.01,cut=0.01,repeat=0.01,garbage=0.3,chunk=1..1448",
        ],
        None,
    ),
    run(
        "65536 bytes, damaged",
        20_000,
        &[
            "--faults",
            "drop=0.01,flip=0.01,cut=0.01,repeat=0.01,garbage=0.3",
        ],
        Some(1 << 16),
    ),
];

/// Sends, counts and prints; an error where a count is wrong.
pub fn table() -> Result<(), Failure> {
    println!("loss, 761 beams, as fast as can be, garbage before 30 % of the telegrams");
    println!(
        "{:<26} {:>8} {:>9} {:>7} {:>10} {:>7} {:>10}",
        "pieces", "sent", "received", "lost", "on purpose", "twice", "garbage B"
    );
    let mut wrong = Vec::new();
    let mut sums = [0; 6];
    for run in &RUNS {
        let counts = count(run, &mut wrong)?;
        print(run.name, counts);
        for (sum, count) in sums.iter_mut().zip(counts) {
            *sum += count;
        }
    }
    print("all", sums);
    match wrong.is_empty() {
        true => Ok(()),
        false => Err(wrong.join("\n")),
    }
}

fn print(name: &str, [sent, received, lost, purpose, twice, garbage]: [u64; 6]) {
    println!("{name:<26} {sent:>8} {received:>9} {lost:>7} {purpose:>10} {twice:>7} {garbage:>10}");
}

/// Runs once; the counts in the order of the table.
fn count(run: &Run, wrong: &mut Vec<String>) -> Result<[u64; 6], Failure> {
    let scanner = Scanner::start(run.scans, &[&["--speed", "max"], run.more].concat())?;
    let relay = match run.gathered {
        Some(most) => Some(Relay::start(&scanner.address, Pieces::Bytes(most))?),
        None => None,
    };
    let place = relay.as_ref().map(|relay| relay.address.to_string());
    let place = place.as_ref().unwrap_or(&scanner.address);
    let Captured {
        records,
        said,
        status,
    } = Capture::start(place, Format::Csv, &[])?.end()?;
    let account = scanner.end()?;
    if let Some(relay) = relay {
        relay.end()?;
    }
    let said = said.join("\n");
    let mut must = |name: &str, is: u64, due: u64| {
        if is != due {
            wrong.push(format!(
                "{}: {name} {is}, not {due} ({status})\n{said}",
                run.name
            ));
        }
    };
    let received = records.len() as u64;
    must("scans sent", account.sent, run.scans);
    must("lost by a slow client", account.lost_else, 0);
    must(
        "scans received",
        received,
        run.scans - account.lost_on_purpose,
    );
    // The numbers of the records are those of a run of scans, each once, in order.
    let order = records.windows(2).filter(|pair| pair[0].seq >= pair[1].seq);
    must("records out of order", order.count() as u64, 0);
    let ends = records.first().zip(records.last());
    let span = ends.map_or(0, |(first, last)| u64::from(last.seq - first.seq) + 1);
    let gaps = span.saturating_sub(received);
    let counted = number_before(&said, " scans lost, ");
    must(
        "gaps that scan-capture counts",
        counted.unwrap_or(u64::MAX),
        gaps,
    );
    // What is lost before the first record or behind the last leaves no gap.
    let outside = run.scans.saturating_sub(span);
    must(
        "gaps and scans outside",
        gaps + outside,
        account.lost_on_purpose,
    );
    let dropped = number_before(&said, " repeated telegrams dropped");
    must(
        "repeated telegrams",
        dropped.unwrap_or(u64::MAX),
        account.twice,
    );
    Ok([
        account.sent,
        received,
        run.scans - received.min(run.scans),
        account.lost_on_purpose,
        account.twice,
        account.garbage_bytes,
    ])
}
