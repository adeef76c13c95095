//! When bytes move: the flush rule, and how signals end a program.
//!
//! Every output of a thread is registered here. Before a reader of that thread makes a read that
//! may block, all of them are flushed, so that a record goes out as soon as it is complete when the
//! input is live, and in batches of a buffer when it is not. Nothing has to be switched on for
//! either, and a stage that waits for a side input follows the same rule.

use super::exit::Fault;
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

/// Lets the first SIGINT pass and the second one end the process with status 130.
///
/// Ctrl-C reaches every program of a pipeline at once. The source ends its stream, and everything
/// behind it must live on until that end has come through.
pub(super) fn drain_on_interrupt() -> io::Result<()> {
    static ONCE: Once = Once::new();
    let mut result = Ok(());
    ONCE.call_once(|| {
        let interrupted = Arc::new(AtomicBool::new(false));
        result = flag::register_conditional_shutdown(SIGINT, 130, Arc::clone(&interrupted))
            .and_then(|_| flag::register(SIGINT, interrupted))
            .map(|_| ());
    });
    result
}

/// SIGINT and SIGTERM for a source: the first asks it to end in good order, a second one ends it.
#[derive(Clone)]
pub struct Stop {
    signal: Arc<AtomicUsize>,
}

impl Stop {
    /// Takes over both signals.
    pub fn install() -> anyhow::Result<Stop> {
        let signal = Arc::new(AtomicUsize::new(0));
        let stopping = Arc::new(AtomicBool::new(false));
        for number in [SIGINT, SIGTERM] {
            flag::register_conditional_shutdown(number, 128 + number, Arc::clone(&stopping))?;
            flag::register(number, Arc::clone(&stopping))?;
            let value = usize::try_from(number).unwrap_or(0);
            flag::register_usize(number, Arc::clone(&signal), value)?;
        }
        Ok(Stop { signal })
    }

    /// SIGTERM alone, for a filter that has a last word to say: the first asks it to end in good
    /// order, a second one ends it. SIGINT is what it is to any filter.
    pub fn install_for_filter() -> anyhow::Result<Stop> {
        drain_on_interrupt()?;
        let signal = Arc::new(AtomicUsize::new(0));
        let stopping = Arc::new(AtomicBool::new(false));
        flag::register_conditional_shutdown(SIGTERM, 128 + SIGTERM, Arc::clone(&stopping))?;
        flag::register(SIGTERM, stopping)?;
        let value = usize::try_from(SIGTERM).unwrap_or(0);
        flag::register_usize(SIGTERM, Arc::clone(&signal), value)?;
        Ok(Stop { signal })
    }

    /// Whether the source should end.
    pub fn requested(&self) -> bool {
        self.signal.load(Ordering::Relaxed) != 0
    }

    /// The end of a source that has written `records`: an error that ends the program with 130 or
    /// 143 where a signal came before any record had.
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
