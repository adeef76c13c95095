//! A progress bar over a file that is being read.

use super::Options;
use indicatif::{ProgressBar, ProgressStyle};
use std::fs::File;
use std::io::{self, IsTerminal, Read};

/// A file that shows on stderr how far it has been read.
pub(super) struct Progress {
    file: File,
    bar: ProgressBar,
}

impl Progress {
    /// `file` with a bar where its `length` is known, stderr is a terminal that stdout's records do
    /// not go to as well, and nobody asked for quiet; else the file alone.
    pub(super) fn around(file: File, length: Option<u64>, options: &Options) -> Box<dyn Read> {
        let alone = options.output.is_none() && io::stdout().is_terminal();
        match length {
            Some(length) if !options.quiet && !alone && io::stderr().is_terminal() => {
                let bar = ProgressBar::new(length);
                let style = "{wide_bar} {binary_bytes}/{binary_total_bytes} {eta}";
                if let Ok(style) = ProgressStyle::with_template(style) {
                    bar.set_style(style);
                }
                Box::new(Progress { file, bar })
            }
            _ => Box::new(file),
        }
    }
}

impl Read for Progress {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let length = self.file.read(buffer)?;
        self.bar.inc(length as u64);
        if length == 0 {
            self.bar.finish_and_clear();
        }
        Ok(length)
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
