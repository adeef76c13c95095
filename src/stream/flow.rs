//! When bytes move: the flush rule, and how signals end a program.
//!
//! Every output of a thread is registered here. Before a reader of that thread makes a read that
//! may block, all of them are flushed, so that a record goes out as soon as it is complete when the
//! input is live, and in batches of a buffer when it is not. Nothing has to be switched on for
//! either, and a stage that waits for a side input follows the same rule.

use super::exit::Fault;
#[cfg(unix)]
use signal_hook::consts::{SIGHUP, SIGXFSZ};
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use std::cell::RefCell;
use std::io::{self, Read};
use std::rc::{Rc, Weak};
use std::sync::Arc;
use std::sync::Once;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Something that holds written bytes back until its thread is about to wait.
pub(super) trait BeforeWait {
    /// Lets the bytes go.
    fn before_wait(&mut self) -> io::Result<()>;
}

thread_local! {
    static OUTPUTS: RefCell<Vec<Weak<RefCell<dyn BeforeWait>>>> = const { RefCell::new(Vec::new()) };
}

/// Puts an output of this thread under the flush rule for as long as it lives.
pub(super) fn register<T: BeforeWait + 'static>(output: &Rc<RefCell<T>>) {
    let weak: Weak<RefCell<T>> = Rc::downgrade(output);
    OUTPUTS.with_borrow_mut(|outputs| {
        outputs.retain(|output| output.strong_count() > 0);
        outputs.push(weak);
    });
}

/// Flushes every output of this thread; to be called before anything that may block.
pub(super) fn before_wait() -> io::Result<()> {
    OUTPUTS.with_borrow(|outputs| {
        for output in outputs.iter().filter_map(Weak::upgrade) {
            // An output that is being written at this moment is not waited for.
            if let Ok(mut output) = output.try_borrow_mut() {
                output.before_wait()?;
            }
        }
        Ok(())
    })
}

/// An input whose reads obey the flush rule and whose errors name it.
pub(super) struct LiveReader<R> {
    inner: R,
    name: String,
}

impl<R: Read> LiveReader<R> {
    pub(super) fn new(inner: R, name: &str) -> Self {
        LiveReader {
            inner,
            name: name.to_owned(),
        }
    }
}

impl<R: Read> Read for LiveReader<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        before_wait()?;
        loop {
            match self.inner.read(buffer) {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                result => return result.map_err(|error| named(&self.name, error)),
            }
        }
    }
}

/// `error` with the name of the file it happened to.
pub(super) fn named(name: &str, error: io::Error) -> io::Error {
    let text = error.to_string();
    let text = text.split(" (os error").next().unwrap_or(&text);
    io::Error::new(error.kind(), format!("{name}: {text}"))
}

/// Lets the first SIGINT pass and the second one end the process with status 130. SIGHUP passes.
///
/// Ctrl-C reaches every program of a pipeline at once, and so does the end of its terminal. The
/// source ends its stream, and everything behind it must live on until that end has come through.
pub(super) fn drain_on_interrupt() -> io::Result<()> {
    static ONCE: Once = Once::new();
    let mut result = Ok(());
    ONCE.call_once(|| {
        let interrupted = Arc::new(AtomicBool::new(false));
        result = flag::register_conditional_shutdown(SIGINT, 130, Arc::clone(&interrupted))
            .and_then(|_| flag::register(SIGINT, interrupted))
            .and_then(|_| on_hangup(&Arc::default(), &Arc::default()));
    });
    result
}

/// Takes over SIGHUP: sets `seen`, and `signal` to its number. It never ends the process by itself,
/// because a terminal that goes away sends it twice, by the kernel and by the shell. Where whoever
/// started the process has it ignored, as nohup does, it stays so.
#[cfg(unix)]
fn on_hangup(seen: &Arc<AtomicBool>, signal: &Arc<AtomicUsize>) -> io::Result<()> {
    if is_ignored(SIGHUP) {
        return Ok(());
    }
    flag::register(SIGHUP, Arc::clone(seen))?;
    flag::register_usize(SIGHUP, Arc::clone(signal), number(SIGHUP))?;
    Ok(())
}

#[cfg(not(unix))]
fn on_hangup(_: &Arc<AtomicBool>, _: &Arc<AtomicUsize>) -> io::Result<()> {
    Ok(())
}

/// Whether the process was started with a signal ignored. Linux tells; elsewhere it counts as not.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status
        .lines()
        .find_map(|line| line.strip_prefix("SigIgn:"))
        .and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    // The lowest bit is signal 1.
    mask.is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}

/// Makes a file that may grow no further (`ulimit -f`) an error of the write, as a full disk is,
/// where it would end the process without a word.
pub(crate) fn outlive_file_limit() {
    #[cfg(unix)]
    {
        // Where this fails the process ends at the limit, as any other does.
        let _ = flag::register(SIGXFSZ, Arc::default());
    }
}

fn number(signal: i32) -> usize {
    usize::try_from(signal).unwrap_or(0)
}

/// SIGINT, SIGTERM and SIGHUP for a source: the first asks it to end in good order, a second SIGINT
/// or SIGTERM ends it. A device must not go on because its terminal went away.
#[derive(Clone)]
pub struct Stop {
    signal: Arc<AtomicUsize>,
}

impl Stop {
    /// Takes over the signals.
    pub fn install() -> anyhow::Result<Stop> {
        let signal = Arc::new(AtomicUsize::new(0));
        let stopping = Arc::new(AtomicBool::new(false));
        for number in [SIGINT, SIGTERM] {
            flag::register_conditional_shutdown(number, 128 + number, Arc::clone(&stopping))?;
            flag::register(number, Arc::clone(&stopping))?;
            flag::register_usize(number, Arc::clone(&signal), self::number(number))?;
        }
        on_hangup(&stopping, &signal)?;
        Ok(Stop { signal })
    }

    /// SIGTERM alone, for a filter that has a last word to say: the first asks it to end in good
    /// order, a second one ends it. SIGINT and SIGHUP are what they are to any filter.
    pub fn install_for_filter() -> anyhow::Result<Stop> {
        drain_on_interrupt()?;
        let signal = Arc::new(AtomicUsize::new(0));
        let stopping = Arc::new(AtomicBool::new(false));
        flag::register_conditional_shutdown(SIGTERM, 128 + SIGTERM, Arc::clone(&stopping))?;
        flag::register(SIGTERM, stopping)?;
        flag::register_usize(SIGTERM, Arc::clone(&signal), number(SIGTERM))?;
        Ok(Stop { signal })
    }

    /// Whether the source should end.
    pub fn requested(&self) -> bool {
        self.signal.load(Ordering::Relaxed) != 0
    }

    /// The end of a source that has written `records`: an error that ends the program with 128 and
    /// the signal's number (129, 130, 143) where one came before any record had.
    pub fn check(&self, records: u64) -> anyhow::Result<()> {
        match self.signal.load(Ordering::Relaxed) {
            0 => Ok(()),
            _ if records > 0 => Ok(()),
            signal => Err(Fault::Interrupted(i32::try_from(signal).unwrap_or(0)).into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Held {
        held: usize,
        out: usize,
    }

    impl BeforeWait for Held {
        fn before_wait(&mut self) -> io::Result<()> {
            self.out += self.held;
            self.held = 0;
            Ok(())
        }
    }

    #[test]
    fn a_read_flushes_first() {
        let output = Rc::new(RefCell::new(Held { held: 3, out: 0 }));
        register(&output);
        let mut reader = LiveReader::new(&b"abc"[..], "input");
        let mut buffer = [0; 2];
        assert_eq!(reader.read(&mut buffer).unwrap(), 2);
        assert_eq!(output.borrow().out, 3);
        // One that is in use is left alone, one that is gone forgotten.
        let guard = output.borrow_mut();
        assert_eq!(reader.read(&mut buffer).unwrap(), 1);
        drop(guard);
        drop(output);
        assert_eq!(reader.read(&mut buffer).unwrap(), 0);
    }

    #[test]
    fn an_io_error_names_its_file() {
        let error = io::Error::from_raw_os_error(28);
        let error = named("disk.csv", error);
        assert_eq!(error.to_string(), "disk.csv: No space left on device");
        assert_eq!(error.kind(), io::ErrorKind::StorageFull);
    }
}
