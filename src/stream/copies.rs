//! One stream for two readers of different records, each in a thread of its own.

use super::input::open_file;
use std::io::{self, Read};
use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

/// Bytes in a piece.
const PIECE: usize = 1 << 16;
/// Pieces that one reader may be ahead of the other.
const AHEAD: usize = 64;

/// One copy of a stream.
pub struct StreamCopy {
    pieces: Receiver<io::Result<Vec<u8>>>,
    piece: Vec<u8>,
    at: usize,
}

/// Two copies of a file, a FIFO or stdin (no path, or `-`). Both must be read to their ends, or
/// dropped, at the same time: neither can run far ahead of the other.
///
/// # Errors
/// [`Fault::NoInput`](super::Fault::NoInput) if the path cannot be opened or is a directory.
pub fn copies(path: Option<&Path>) -> anyhow::Result<[StreamCopy; 2]> {
    let mut bytes: Box<dyn Read + Send> = match path {
        Some(path) if path != Path::new("-") => Box::new(open_file(path)?.0),
        _ => Box::new(io::stdin()),
    };
    let ((a, first), (b, second)) = (sync_channel(AHEAD), sync_channel(AHEAD));
    thread::spawn(move || distribute(&mut bytes, [a, b]));
    Ok([first, second].map(|pieces| StreamCopy {
        pieces,
        piece: Vec::new(),
        at: 0,
    }))
}

/// Gives every piece to every reader that is still there.
fn distribute(bytes: &mut dyn Read, readers: [SyncSender<io::Result<Vec<u8>>>; 2]) {
    let mut block = vec![0; PIECE];
    loop {
        let piece = match bytes.read(&mut block) {
            Ok(0) => return,
            Ok(n) => Ok(block.get(..n).unwrap_or_default().to_vec()),
            Err(e) if e.kind() == io::ErrorKind::Interrupted => continue,
            Err(e) => Err(e),
        };
        let mut anyone = false;
        for reader in &readers {
            let piece = match &piece {
                Ok(bytes) => Ok(bytes.clone()),
                Err(e) => Err(io::Error::new(e.kind(), e.to_string())),
            };
            anyone |= reader.send(piece).is_ok();
        }
        if !anyone || piece.is_err() {
            return;
        }
    }
}

impl Read for StreamCopy {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        if self.at == self.piece.len() {
            match self.pieces.recv() {
                Ok(piece) => (self.piece, self.at) = (piece?, 0),
                Err(_) => return Ok(0),
            }
        }
        let rest = self.piece.get(self.at..).unwrap_or_default();
        let n = rest.len().min(into.len());
        into[..n].copy_from_slice(&rest[..n]);
        self.at += n;
        Ok(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_copies_are_whole() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.lock");
        let whole = std::fs::read(&path).unwrap();
        let [mut a, mut b] = copies(Some(&path)).unwrap();
        let second = thread::spawn(move || {
            let mut bytes = Vec::new();
            b.read_to_end(&mut bytes).map(|_| bytes)
        });
        let mut first = Vec::new();
        a.read_to_end(&mut first).unwrap();
        assert!(first == whole && second.join().unwrap().unwrap() == whole);
    }

    #[test]
    fn one_reader_may_leave() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.lock");
        let [mut a, b] = copies(Some(&path)).unwrap();
        drop(b);
        let mut bytes = Vec::new();
        a.read_to_end(&mut bytes).unwrap();
        assert!(!bytes.is_empty());
        for nothing in [Path::new("no such file"), path.parent().unwrap()] {
            let error = copies(Some(nothing)).err().unwrap();
            assert_eq!(crate::stream::exit::status(&error), 66);
        }
    }
}
