//! What the replays of the captures share: arrival times beside a recording.

use crate::link::{Arrivals, times_beside};
use crate::stream::Fault;
use std::fs::File;
use std::path::{Path, PathBuf};

/// Which arrival times belong to recordings.
#[derive(Clone, Copy)]
pub(super) enum Times<'a> {
    /// Those of this table, which is of the only recording.
    Of(&'a Path),
    /// Those beside each recording, where there are any.
    Beside,
    /// None.
    Ignored,
}

impl<'a> Times<'a> {
    /// What `--times`, `--no-times` and the recordings named together mean.
    ///
    /// # Errors
    /// Several recordings and one table, or one of them on stdin.
    pub(super) fn new(
        recordings: &[PathBuf],
        table: Option<&'a Path>,
        ignored: bool,
    ) -> Result<Times<'a>, Fault> {
        let several = recordings.len() > 1;
        if several && recordings.iter().any(|path| path == Path::new("-")) {
            let text = "-: stdin is one recording, and others are named as well";
            return Err(Fault::Usage(text.into()));
        }
        match table {
            Some(_) if several => Err(Fault::Usage(
                "--times is the table of one recording, and there are several".into(),
            )),
            Some(table) => Ok(Times::Of(table)),
            None if ignored => Ok(Times::Ignored),
            None => Ok(Times::Beside),
        }
    }

    /// The arrival times of a recording.
    ///
    /// # Errors
    /// A table that cannot be opened (66) or understood (65).
    pub(super) fn read(self, recording: &Path) -> Result<Option<Arrivals>, Fault> {
        let beside = times_beside(recording);
        let path = match self {
            Times::Of(table) => table,
            Times::Beside if recording != Path::new("-") && beside.is_file() => &beside,
            Times::Beside | Times::Ignored => return Ok(None),
        };
        let name = path.display();
        let file = File::open(path).map_err(|error| Fault::NoInput(format!("{name}: {error}")))?;
        let arrivals = Arrivals::read(file);
        arrivals
            .map(Some)
            .map_err(|error| Fault::BadData(format!("{name}: {error}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_of_one_recording() {
        let table = Path::new("no-such-table.csv");
        let times = |recordings: &[&str], table| {
            let recordings: Vec<PathBuf> = recordings.iter().map(PathBuf::from).collect();
            Times::new(&recordings, table, false).map_err(|fault| fault.status())
        };
        assert!(matches!(times(&["a", "b"], Some(table)), Err(2)));
        assert!(matches!(times(&["a", "-"], None), Err(2)));
        assert!(matches!(times(&["a", "b"], None), Ok(Times::Beside)));
        let of_table = times(&["a"], Some(table)).unwrap();
        assert_eq!(of_table.read(Path::new("a")).unwrap_err().status(), 66);
        assert_eq!(Times::Ignored.read(table).unwrap(), None);
    }
}
