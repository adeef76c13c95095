//! A directory for a test's files.

use std::fs;
use std::path::{Path, PathBuf};

/// A directory of its own in the system's temporary directory, removed at the end.
pub(crate) struct Scratch(PathBuf);

impl Scratch {
    /// An empty directory for the test of that name.
    pub(crate) fn new(test: &str) -> Scratch {
        let name = format!("cablepose-{}-{test}", std::process::id());
        let directory = std::env::temp_dir().join(name);
        fs::create_dir_all(&directory).unwrap();
        Scratch(directory)
    }

    /// The directory.
    pub(crate) fn directory(&self) -> &Path {
        &self.0
    }

    /// A file in it, whether it is there or not.
    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}
