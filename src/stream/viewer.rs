//! Messages that only a 3D viewer needs.

use crate::frame::Frame;

/// A message for a viewer, written with [`super::Emit::note`].
#[derive(Clone, Debug)]
pub struct Note(());

/// The frame's box, plates and strips as markers.
pub fn frame_messages(_frame: &Frame) -> Vec<Note> {
    Vec::new()
}
