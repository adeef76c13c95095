//! A stream that is read and goes on unchanged, byte by byte.

use super::check::StreamRecord;
use super::exit::Fault;
use super::input::Input;
use super::output::stdout_unbuffered;
use super::{Encoding, Options, Role, Window};
use std::cell::RefCell;
use std::io::{self, IsTerminal, Read, Write};
use std::path::Path;
use std::rc::Rc;

/// Bytes that were read and are still to be passed on.
struct Passing<W: Write> {
    out: W,
    held: Vec<u8>,
}

impl<W: Write> Passing<W> {
    fn pass(&mut self) -> io::Result<()> {
        let result = self.out.write_all(&self.held);
        self.held.clear();
        result
    }
}

/// A reader whose bytes are passed on before the next ones are read: what is in them has been
/// looked at by then, and nobody who reads them can delay that.
struct PassingReader<R: Read, W: Write> {
    inner: R,
    passing: Rc<RefCell<Passing<W>>>,
}

impl<R: Read, W: Write> Read for PassingReader<R, W> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut passing = self.passing.borrow_mut();
        passing.pass()?;
        let count = self.inner.read(buffer)?;
        let came = buffer.get(..count).unwrap_or_default();
        passing.held.extend_from_slice(came);
        Ok(count)
    }
}

/// Whether stdin can go to stdout as it is: nothing in the options wants it otherwise.
pub fn passes_unchanged(options: &Options) -> bool {
    let to_stdout = options.output.as_deref();
    to_stdout.is_none_or(|path| path == Path::new("-"))
        && options.format.is_none()
        && !options.skip_bad
        && options.window == Window::default()
}

/// Reads stdin's records and passes its bytes on to stdout as they are: columns and messages that
/// nobody here knows included. Each record is shown to `each` before its bytes go on. How many there
/// were.
///
/// # Errors
/// What reading, writing or `each` says; everything read until then has been passed on.
pub fn pass_unchanged<R: StreamRecord>(
    options: &Options,
    each: impl FnMut(&R) -> anyhow::Result<()>,
) -> anyhow::Result<u64> {
    pass_between(io::stdin(), stdout_unbuffered(), options, each)
}

fn pass_between<R: StreamRecord>(
    from: impl Read + 'static,
    to: impl Write + 'static,
    options: &Options,
    mut each: impl FnMut(&R) -> anyhow::Result<()>,
) -> anyhow::Result<u64> {
    let passing = Rc::new(RefCell::new(Passing {
        out: to,
        held: Vec::new(),
    }));
    let reader = PassingReader {
        inner: from,
        passing: Rc::clone(&passing),
    };
    let read = || -> anyhow::Result<u64> {
        let mut input = Input::<R>::from_reader(reader, "stdin", Role::Desired, options)?;
        if input.encoding() == Encoding::Mcap && io::stdout().is_terminal() {
            passing.borrow_mut().held.clear();
            let text = "MCAP is binary and stdout a terminal: redirect it";
            return Err(Fault::Usage(text.into()).into());
        }
        while let Some(record) = input.next()? {
            each(record)?;
        }
        Ok(input.records())
    };
    let read = read();
    let passed = passing.borrow_mut().pass();
    let records = read?;
    passed?;
    Ok(records)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::Pose;

    #[derive(Clone, Default)]
    struct Shared(Rc<RefCell<Vec<u8>>>);

    impl Write for Shared {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.borrow_mut().extend_from_slice(bytes);
            Ok(bytes.len())
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    /// One byte at a time.
    struct Slow(&'static [u8]);

    impl Read for Slow {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            let one = buffer.len().min(1);
            self.0.read(&mut buffer[..one])
        }
    }

    const ROWS: &str = "stamp_ns,note,x_m,y_m,z_m,roll_rad,pitch_rad,yaw_rad\n\
                        1,\"a, b\",0.50,1,2,0,0,0\r\n2,,1e0,1,2,0,0,0\n";

    #[test]
    fn bytes_go_on_as_they_came() {
        for slow in [false, true] {
            let out = Shared::default();
            let from: Box<dyn Read> = if slow {
                Box::new(Slow(ROWS.as_bytes()))
            } else {
                Box::new(ROWS.as_bytes())
            };
            let mut seen = Vec::new();
            let each = |pose: &Pose| {
                seen.push(pose.position_m[0]);
                Ok(())
            };
            let options = Options::default();
            let count = pass_between(from, out.clone(), &options, each).unwrap();
            assert_eq!((count, seen), (2, vec![0.5, 1.0]));
            assert_eq!(*out.0.borrow(), ROWS.as_bytes());
        }
    }

    #[test]
    fn what_came_before_a_fault_goes_on() {
        let out = Shared::default();
        let rows: &[u8] = b"stamp_ns,x_m,y_m,z_m,roll_rad,pitch_rad,yaw_rad\n1,0,1,2,0,0,0\n2,?\n";
        let mut seen = 0;
        let each = |_: &Pose| {
            seen += 1;
            Ok(())
        };
        let result = pass_between(rows, out.clone(), &Options::default(), each);
        assert_eq!(super::super::exit::status(&result.unwrap_err()), 65);
        assert_eq!((seen, out.0.borrow().as_slice()), (1, rows));
    }
}
