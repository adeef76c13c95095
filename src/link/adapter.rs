//! What a USB adapter does to the bytes that go through it.

use std::fs;
use std::path::{Path, PathBuf};

/// Where the system lists USB adapters.
const SYSTEM: &str = "/sys/bus/usb-serial/devices";

/// For how long an adapter holds bytes back before it hands them over.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LatencyTimer {
    /// The timer, ms.
    pub ms: u32,
    /// The file that sets it.
    pub file: PathBuf,
}

/// The latency timer of the adapter behind a serial port; none where the port is no USB adapter or
/// its driver has no such timer.
pub fn latency_timer(port: &Path) -> Option<LatencyTimer> {
    latency_timer_in(Path::new(SYSTEM), port)
}

fn latency_timer_in(system: &Path, port: &Path) -> Option<LatencyTimer> {
    // Names that stay the same (/dev/serial/by-id/...) are links.
    let device = fs::canonicalize(port).unwrap_or_else(|_| port.to_owned());
    let file = system.join(device.file_name()?).join("latency_timer");
    let ms = fs::read_to_string(&file).ok()?.trim().parse().ok()?;
    Some(LatencyTimer { ms, file })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_timer_is_found_through_a_link() {
        let name = format!("cablepose-adapter-{}", std::process::id());
        let dir = std::env::temp_dir().join(name);
        fs::create_dir_all(dir.join("ttyUSB7")).unwrap();
        fs::write(dir.join("ttyUSB7/latency_timer"), "16\n").unwrap();
        fs::create_dir_all(dir.join("dev")).unwrap();
        fs::write(dir.join("dev/ttyUSB7"), "").unwrap();
        std::os::unix::fs::symlink("ttyUSB7", dir.join("dev/by-id")).unwrap();
        let timer = latency_timer_in(&dir, &dir.join("dev/by-id")).unwrap();
        assert_eq!(timer.ms, 16);
        assert_eq!(timer.file, dir.join("ttyUSB7/latency_timer"));
        assert_eq!(latency_timer_in(&dir, &dir.join("dev/ttyS0")), None);
        fs::remove_dir_all(&dir).unwrap();
    }
}
