//! What an emulated scanner sees: a simulation or a recording.

use super::Sides;
use super::unit::Origin;
use crate::frame::ScanMode;
use crate::record::{Scan, Stamp};
use crate::sick::emulator::recording::Recording;
use crate::sick::emulator::{Revolution, Source, fill};
use crate::sick::scandata::LmdScandata;
use crate::simulate::Simulator;
use std::sync::Arc;

/// A simulation that is looked at by an emulated scanner, and the files beside it.
pub struct Simulation {
    simulator: Simulator,
    start: Stamp,
    /// From the zero index to the beam at the aperture's start, ns.
    index_to_first_beam_ns: i64,
    sides: Sides,
    /// Where others learn when the course began.
    origin: Option<Arc<Origin>>,
    /// Why a file beside the scans could not be written.
    fault: Option<anyhow::Error>,
}

impl Simulation {
    /// A simulation whose first scan begins at `start`.
    pub fn new(
        simulator: Simulator,
        start: Stamp,
        index_to_first_beam_s: f64,
        sides: Sides,
        origin: Option<Arc<Origin>>,
    ) -> Simulation {
        Simulation {
            simulator,
            start,
            index_to_first_beam_ns: (index_to_first_beam_s * 1e9).round() as i64,
            sides,
            origin,
            fault: None,
        }
    }

    /// Ends the files beside the scans.
    pub(super) fn finish(self) -> anyhow::Result<()> {
        match self.fault {
            Some(fault) => Err(fault),
            None => self.sides.finish(),
        }
    }
}

impl Source for Simulation {
    fn began(&mut self, now_ns: i64) {
        if let Some(origin) = &self.origin {
            origin.begin(now_ns);
        }
    }

    fn next(
        &mut self,
        mode: ScanMode,
        measured: bool,
        telegram: &mut LmdScandata,
    ) -> Option<Revolution> {
        if self.fault.is_some() {
            return None;
        }
        self.simulator.set_mode(mode);
        let complete = if measured {
            let step = self.simulator.advance()?;
            fill(&step.scan, telegram);
            if let Err(fault) = self.sides.write(step) {
                self.fault = Some(fault);
                return None;
            }
            step.complete
        } else {
            self.simulator.pass()?
        };
        // The scanner still stands at the scan that was just made.
        let scanner = self.simulator.scanner();
        let sweep_ns = ((scanner.sweep_s() + scanner.lead_s()) * 1e9).round() as i64;
        let end_ns = complete - self.start + self.index_to_first_beam_ns;
        Some(Revolution {
            index_ns: end_ns - sweep_ns - self.index_to_first_beam_ns,
            end_ns,
            transmit_after_ns: None,
        })
    }
}

impl crate::hokuyo::emulator::Source for Simulation {
    fn next(&mut self, scan: &mut Scan) -> Option<(i64, i64)> {
        if self.fault.is_some() {
            return None;
        }
        let step = self.simulator.advance()?;
        scan.clone_from(&step.scan);
        if let Err(fault) = self.sides.write(step) {
            self.fault = Some(fault);
            return None;
        }
        let complete = step.complete;
        let sweep_ns = (self.simulator.scanner().sweep_s() * 1e9).round() as i64;
        let end_ns = complete - self.start + self.index_to_first_beam_ns;
        Some((end_ns - sweep_ns - self.index_to_first_beam_ns, end_ns))
    }
}

/// Either of them.
pub enum View {
    /// A simulation.
    Simulation(Box<Simulation>),
    /// A recording.
    Recording(Recording),
}

impl View {
    /// The true time of the source's start, where it has one.
    pub fn epoch(&self) -> Option<Stamp> {
        match self {
            View::Simulation(simulation) => {
                Some(simulation.start + -simulation.index_to_first_beam_ns)
            }
            View::Recording(_) => None,
        }
    }

    /// Ends the files beside it.
    pub fn finish(self) -> anyhow::Result<()> {
        match self {
            View::Simulation(simulation) => simulation.finish(),
            View::Recording(_) => Ok(()),
        }
    }
}

impl Source for View {
    fn began(&mut self, now_ns: i64) {
        match self {
            View::Simulation(simulation) => simulation.began(now_ns),
            View::Recording(recording) => recording.began(now_ns),
        }
    }

    fn next(
        &mut self,
        mode: ScanMode,
        measured: bool,
        telegram: &mut LmdScandata,
    ) -> Option<Revolution> {
        match self {
            View::Simulation(simulation) => simulation.next(mode, measured, telegram),
            View::Recording(recording) => recording.next(mode, measured, telegram),
        }
    }

    fn fixed_mode(&self) -> Option<ScanMode> {
        match self {
            View::Simulation(_) => None,
            View::Recording(recording) => recording.fixed_mode(),
        }
    }

    fn coverage(&self) -> Option<[i32; 2]> {
        match self {
            View::Simulation(_) => None,
            View::Recording(recording) => recording.coverage(),
        }
    }
}
