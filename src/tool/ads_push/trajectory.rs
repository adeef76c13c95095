//! The controller's desired motion on its way out: stamps, and the thread that writes.

use super::args::ReadTime;
use crate::clock::OneWayHull;
use crate::link::HostInstant;
use crate::record::{Stamp, TrajectoryPoint};
use crate::stream::{Encoding, Fault, Options, Output};
use crate::twincat::fields::{Quantity, filetime};
use crate::twincat::image::Image;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;

/// Points that may wait to be written.
const ROOM: usize = 1024;

/// Where points go.
pub(super) struct Trajectory {
    time: ReadTime,
    map: OneWayHull,
    last: Option<Stamp>,
    sender: Option<SyncSender<TrajectoryPoint>>,
    writer: Option<JoinHandle<anyhow::Result<()>>>,
    most: Option<u64>,
    /// Points that went out.
    pub points: u64,
    /// Points that nobody took in time, and values with something in them that is no number.
    pub dropped: u64,
    /// Whether what is to be said of the stamps has been said.
    remarked: bool,
}

impl Trajectory {
    /// Starts the thread that writes: to `to`, or to the main output.
    pub(super) fn start(
        options: &Options,
        to: Option<PathBuf>,
        time: ReadTime,
        most: Option<u64>,
    ) -> Trajectory {
        let (sender, receiver) = sync_channel(ROOM);
        let mut options = options.clone();
        let what = match time {
            ReadTime::Mapped => "the controller's, mapped to the host's clock",
            ReadTime::Notified => "of the notification, mapped to the host's clock",
            ReadTime::Plc => "the controller's, as they are",
            ReadTime::Arrival => "of arrival at the host",
        };
        options.notes.insert("stamps".to_owned(), what.to_owned());
        // Opening a FIFO waits for its reader.
        let writer = std::thread::spawn(move || write(&options, to, &receiver));
        Trajectory {
            time,
            map: OneWayHull::default(),
            last: None,
            sender: Some(sender),
            writer: Some(writer),
            most,
            points: 0,
            dropped: 0,
            // Only stamps of arrival are worth a remark.
            remarked: time != ReadTime::Arrival,
        }
    }

    /// Takes a value as it came.
    pub(super) fn take(
        &mut self,
        image: &Image,
        bytes: &[u8],
        notified: Option<u64>,
        at: HostInstant,
    ) {
        if self.is_full() {
            return;
        }
        let Some(mut point) = image.read(bytes) else {
            self.dropped += 1;
            return;
        };
        let device = match self.time {
            ReadTime::Mapped | ReadTime::Plc => Some(point.stamp),
            ReadTime::Notified => notified.map(filetime),
            ReadTime::Arrival => None,
        };
        point.stamp = match (self.time, device) {
            (ReadTime::Plc, Some(stamp)) => stamp,
            (_, Some(device)) => {
                let mapped = self.map.push(device.ns(), at.utc.ns());
                Stamp::from_ns(mapped.host_ns)
            }
            (_, None) => at.utc,
        };
        // A value that is asked for more often than it changes is one point.
        if self.last.is_some_and(|last| point.stamp <= last) {
            return;
        }
        // What is not read is zero: a controller that has no attitude keeps the platform level.
        let is_read = |component| {
            let wanted = Quantity::Component(component);
            image.fields().any(|field| field.quantity == wanted)
        };
        let places = point.position_m.iter_mut().chain(&mut point.rotation_rad);
        for (component, place) in places.enumerate() {
            if !is_read(component) {
                *place = 0.0;
            } else if !place.is_finite() {
                self.dropped += 1;
                return;
            }
        }
        self.last = Some(point.stamp);
        let sent = self.sender.as_ref().map(|sender| sender.try_send(point));
        match sent {
            Some(Ok(())) => self.points += 1,
            Some(Err(TrySendError::Full(_))) => self.dropped += 1,
            Some(Err(TrySendError::Disconnected(_))) | None => self.sender = None,
        }
    }

    /// Whether as many points as were asked for have gone out.
    pub(super) fn is_full(&self) -> bool {
        self.most.is_some_and(|most| self.points >= most)
    }

    /// Whether nobody takes points any more.
    pub(super) fn is_over(&self) -> bool {
        self.sender.is_none() || self.writer.as_ref().is_some_and(JoinHandle::is_finished)
    }

    /// A remark on the stamps, once, where they are not the controller's.
    pub(super) fn remark(&mut self) -> Option<&'static str> {
        let first = self.points > 0 && !self.remarked;
        self.remarked |= first;
        first.then_some("points are stamped on arrival: the way from the controller is in them")
    }

    /// Lets what waits be written, unless nobody has opened the other end.
    pub(super) fn finish(&mut self) -> anyhow::Result<()> {
        self.sender = None;
        let Some(writer) = self.writer.take() else {
            return Ok(());
        };
        if self.points == 0 && !writer.is_finished() {
            // It may still wait for a FIFO's reader; an empty stream has to be written all the same.
            std::thread::sleep(std::time::Duration::from_millis(50));
            if !writer.is_finished() {
                return Ok(());
            }
        }
        let fell =
            |_| anyhow::Error::from(Fault::Io("the writer of the trajectory fell over".into()));
        writer.join().map_err(fell)?
    }
}

fn write(
    options: &Options,
    to: Option<PathBuf>,
    points: &Receiver<TrajectoryPoint>,
) -> anyhow::Result<()> {
    let mut output = match to {
        Some(path) => {
            let encoding = options.format.unwrap_or(Encoding::Csv);
            Output::create(&path, encoding, options)?
        }
        None => Output::open(options)?,
    };
    loop {
        let point = match points.try_recv() {
            Ok(point) => point,
            Err(_) => {
                output.flush()?;
                match points.recv() {
                    Ok(point) => point,
                    Err(_) => return output.finish_kind::<TrajectoryPoint>(),
                }
            }
        };
        output.write(&point)?;
    }
}
