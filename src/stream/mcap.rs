//! MCAP streams.

use super::check::StreamRecord;
use super::csv::RowError;
use super::exit::Fault;
use super::output::Output;
use super::provenance::Provenance;
use super::viewer::Note;
use super::window::WindowState;
use super::{Options, Role};
use std::io::{Read, Write};
use std::marker::PhantomData;

fn not_yet<T>() -> anyhow::Result<T> {
    Err(Fault::Unavailable("MCAP is not built yet; use CSV".into()).into())
}

pub(super) struct McapWriter<W: Write>(PhantomData<W>);
impl<W: Write> McapWriter<W> {
    pub(super) fn new(_: W, _file: bool, _: &Options) -> anyhow::Result<Self> {
        not_yet()
    }
    pub(super) fn write<R: StreamRecord>(&mut self, _: &R, _: Role) -> anyhow::Result<()> {
        not_yet()
    }
    pub(super) fn declare<R: StreamRecord>(&mut self) -> anyhow::Result<()> {
        not_yet()
    }
    pub(super) fn note(&mut self, _: &[Note]) -> anyhow::Result<()> {
        not_yet()
    }
    pub(super) fn flush(&mut self) -> anyhow::Result<()> {
        not_yet()
    }
    pub(super) fn before_wait(&mut self) -> anyhow::Result<()> {
        not_yet()
    }
    pub(super) fn finish(&mut self) -> anyhow::Result<()> {
        not_yet()
    }
}

pub(super) struct McapReader<R>(R);
impl<R: StreamRecord> McapReader<R> {
    pub(super) fn new(_: Box<dyn Read>, _: &str, _: Role) -> Self {
        McapReader(R::default())
    }
    pub(super) fn advance(
        &mut self,
        _: Option<&Output>,
        _: &mut WindowState,
    ) -> Result<bool, RowError> {
        not_yet().map_err(RowError::Fatal)
    }
    pub(super) fn record(&self) -> &R {
        &self.0
    }
    pub(super) fn provenance(&self) -> &[Provenance] {
        &[]
    }
}
