//! `--from` and `--to`: which records a tool is asked for.

use super::{Instant, Window};
use crate::record::Stamp;

/// Where a stamp lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Before the first instant wanted.
    Before,
    /// Wanted.
    Inside,
    /// After the last instant wanted.
    After,
}

/// A window whose relative ends count from the first stamp that it sees.
#[derive(Clone, Copy, Debug)]
pub struct WindowState {
    window: Window,
    first: Option<Stamp>,
}

impl WindowState {
    /// A window that has seen no stamp.
    pub fn new(window: Window) -> Self {
        WindowState {
            window,
            first: None,
        }
    }

    /// Where a stamp of the stream's own records lies; the first one is where `+10s` counts from.
    pub fn place(&mut self, stamp: Stamp) -> Place {
        let first = *self.first.get_or_insert(stamp);
        let at = |instant| match instant {
            Instant::At(stamp) => stamp,
            Instant::After(seconds) => first.plus_s(seconds),
        };
        if self.window.from.is_some_and(|from| stamp < at(from)) {
            Place::Before
        } else if self.window.to.is_some_and(|to| stamp > at(to)) {
            Place::After
        } else {
            Place::Inside
        }
    }

    /// Whether a message that is passed on lies inside. Only one of the stream's `own` topics
    /// starts the clock of relative ends; what comes before that is passed on.
    pub(super) fn passes(&mut self, stamp: Stamp, own: bool) -> bool {
        if self.window == Window::default() || (self.first.is_none() && !own) {
            return true;
        }
        self.place(stamp) == Place::Inside
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_are_inside() {
        let s = |seconds: i64| Stamp::from_ns(1_000_000_000 * (100 + seconds));
        let mut window = WindowState::new(Window {
            from: Some(Instant::After(2.0)),
            to: Some(Instant::At(s(5))),
        });
        let places: Vec<Place> = (0..7).map(|i| window.place(s(i))).collect();
        assert_eq!(places[..2], [Place::Before; 2]);
        assert_eq!(places[2..6], [Place::Inside; 4]);
        assert_eq!(places[6], Place::After);
        let mut open = WindowState::new(Window::default());
        assert_eq!(open.place(s(-9)), Place::Inside);
    }
}
