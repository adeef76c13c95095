//! A connection with everything found, checked and fetched that writing and reading need.

use super::args::{Fields, LayoutArgs, ReadTime, usual, usual_read};
use crate::link::HostInstant;
use crate::stream::Fault;
use crate::twincat::ams::{Request, Transmission, index};
use crate::twincat::client::{InvokeId, PlcState};
use crate::twincat::image::{Image, Missing, Variable, Wanted};
use crate::twincat::layout::{Layout, LayoutError};
use crate::twincat::variables::{self, Handles, VariableError};
use crate::twincat::{Client, ClientError, Code, LocalAddress, Target};
use std::time::{Duration, Instant};

/// A host that does not answer is given up after this; a write may take less.
const CONNECT: Duration = Duration::from_secs(1);
/// The program's version and state are asked for so often.
const WATCH: Duration = Duration::from_secs(1);

/// Where and how.
#[derive(Clone, Debug)]
pub(super) struct Link {
    pub target: Target,
    pub local: LocalAddress,
    pub timeout: Duration,
}

/// What is written.
#[derive(Clone, Debug)]
pub(super) struct WritePlan {
    pub symbols: Vec<Wanted>,
    pub layout: LayoutArgs,
}

/// What is read.
#[derive(Clone, Debug)]
pub(super) struct ReadPlan {
    pub symbol: String,
    pub fields: Option<Fields>,
    pub layout: Option<Layout>,
    /// Where a point's stamp comes from.
    pub time: ReadTime,
    /// How often it is sent, or asked for.
    pub period: Duration,
    pub polled: bool,
}

/// Why there is no connection, or none that can be used.
#[derive(Debug)]
pub(super) enum Setback {
    /// It may pass by waiting.
    Away(String),
    /// What the controller has does not fit the command line.
    Unfit(String),
}

impl Setback {
    pub(super) fn text(&self) -> &str {
        match self {
            Setback::Away(text) | Setback::Unfit(text) => text,
        }
    }

    /// The fault that ends the program.
    pub(super) fn fault(self) -> Fault {
        match self {
            Setback::Away(text) => Fault::Unavailable(text),
            Setback::Unfit(text) => Fault::Configuration(text),
        }
    }

    /// What an error says, with what to do.
    pub(super) fn of(error: &VariableError, link: &Link, client: Option<&Client>) -> Setback {
        match error {
            VariableError::Client(error) => Setback::Away(told(error, link, client)),
            other => Setback::Unfit(other.to_string()),
        }
    }
}

/// An error of the connection, with its usual causes.
pub(super) fn told(error: &ClientError, link: &Link, client: Option<&Client>) -> String {
    let target = &link.target;
    let us = client.map(|client| client.source().net_id);
    let us = us.map_or_else(|| "this host's NetId".to_owned(), |us| us.to_string());
    match error {
        ClientError::Link(_) if client.is_some() => format!(
            "{target}: {error}. Does the controller have a route for NetId {us} and this host's \
             address (--add-route)? Does another program on this host talk to it? It keeps one \
             connection a host"
        ),
        ClientError::Timeout { .. } => format!(
            "{target}: {error} (what other clients call error 1861). Is there a route for NetId {us} \
             on the controller, is the NetId right, is its PLC running?"
        ),
        ClientError::Refused(code) if *code == Code::NO_MACHINE => format!(
            "{target}: {code}. Does the controller have a route for NetId {us} (--add-route)?"
        ),
        _ => format!("{target}: {error}"),
    }
}

/// What is read, found and fetched.
pub(super) struct Reading {
    pub image: Image,
    handles: Handles,
    /// The notification, if it is not polled.
    notification: Option<u32>,
    polled: Option<Polled>,
}

struct Polled {
    period: Duration,
    due: Instant,
    open: Option<InvokeId>,
}

/// A connection that is ready.
pub(super) struct Session {
    pub client: Client,
    pub write: Option<(Image, Handles)>,
    pub read: Option<Reading>,
    pub state: PlcState,
    version: Option<u8>,
    watch_due: Instant,
    watched: Option<[InvokeId; 2]>,
    timeout: Duration,
}

/// What watching has found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Found {
    Nothing,
    /// Another program: everything is to be found again.
    NewProgram,
    /// Another state of the PLC.
    NewState(PlcState),
}

impl Session {
    /// Connects, finds and checks everything. `older` is what was there before.
    pub(super) fn open(
        link: &Link,
        write: Option<&WritePlan>,
        read: Option<&ReadPlan>,
        older: Option<&Image>,
    ) -> Result<Session, Setback> {
        let limit = CONNECT.max(link.timeout);
        let mut client = Client::connect(&link.target, link.local, limit)
            .map_err(|error| Setback::Away(told(&error, link, None)))?;
        let opened = |client: &mut Client| -> Result<_, VariableError> {
            let state = client.state(limit)?;
            let version = version(client, limit)?;
            let write = write.map(|plan| ready_to_write(client, plan, older, limit));
            let write = write.transpose()?;
            let read = read
                .map(|plan| ready_to_read(client, plan, limit))
                .transpose()?;
            Ok((state, version, write, read))
        };
        match opened(&mut client) {
            Ok((state, version, write, read)) => Ok(Session {
                client,
                write,
                read,
                state,
                version,
                watch_due: Instant::now() + WATCH,
                watched: None,
                timeout: link.timeout,
            }),
            Err(error) => Err(Setback::of(&error, link, Some(&client))),
        }
    }

    /// Finds everything again over the same connection: the program has changed.
    pub(super) fn renew(
        &mut self,
        write: Option<&WritePlan>,
        read: Option<&ReadPlan>,
    ) -> Result<(), VariableError> {
        let limit = CONNECT.max(self.timeout);
        let client = &mut self.client;
        if let Some(plan) = write {
            let older = self.write.take().map(|(image, _)| image);
            self.write = Some(ready_to_write(client, plan, older.as_ref(), limit)?);
        }
        if let Some(plan) = read {
            self.read = None;
            self.read = Some(ready_to_read(client, plan, limit)?);
        }
        self.version = version(client, limit)?;
        Ok(())
    }

    /// Asks for version and state when that is due, without waiting, and looks at what has come.
    pub(super) fn watch(&mut self) -> Result<Found, ClientError> {
        if let Some([version, state]) = self.watched
            && let Some(state) = self.client.answer(state)
        {
            self.watched = None;
            // Not every server has a version.
            let version = self.client.answer(version).and_then(Result::ok);
            let version = version.and_then(|payload| payload.get(4).copied());
            if version.is_some() && self.version.is_some() && version != self.version {
                return Ok(Found::NewProgram);
            }
            // A runtime that is away for a moment comes back without notifications and handles, even
            // if the program and the connection to the router are the same.
            let state = PlcState::parse(&state?);
            if let Some(state) = state.filter(|state| *state != self.state) {
                self.state = state;
                return Ok(Found::NewState(state));
            }
        }
        if Instant::now() >= self.watch_due {
            if let Some(unanswered) = self.watched.take() {
                for id in unanswered {
                    self.client.forget(id);
                }
            }
            self.watch_due = Instant::now() + WATCH;
            let version = Request::Read {
                group: index::SYMBOL_VERSION,
                offset: 0,
                length: 1,
            };
            let version = self.client.send(&version, self.timeout)?;
            let state = self.client.send(&Request::ReadState, self.timeout)?;
            self.watched = Some([version, state]);
        }
        Ok(Found::Nothing)
    }

    /// Whether nothing has come for so long that the other side must be gone: it is asked every
    /// second.
    pub(super) fn is_silent(&self) -> bool {
        self.client.silence() > WATCH + 3 * self.timeout
    }

    /// How long nothing is due.
    pub(super) fn idle(&self) -> Duration {
        let due = self
            .read
            .as_ref()
            .and_then(|read| Some(read.polled.as_ref()?.due));
        let due = due.map_or(self.watch_due, |due| due.min(self.watch_due));
        due.saturating_duration_since(Instant::now())
    }

    /// Asks for the value that is read, when that is due, and gives every value that has come to
    /// `take`: its bytes, the controller's time (100 ns since 1601) if it told it, and the host's.
    pub(super) fn read(
        &mut self,
        mut take: impl FnMut(&Image, &[u8], Option<u64>, HostInstant),
    ) -> Result<(), ClientError> {
        let Some(reading) = &mut self.read else {
            return Ok(());
        };
        while let Some((notified, at)) = self.client.notified() {
            if Some(notified.handle) == reading.notification {
                take(&reading.image, &notified.data, Some(notified.filetime), at);
            }
        }
        let Some(polled) = &mut reading.polled else {
            return Ok(());
        };
        if let Some(answer) = polled.open.and_then(|open| self.client.answer(open)) {
            polled.open = None;
            let payload = answer?;
            let value = payload.get(4..).unwrap_or_default();
            take(&reading.image, value, None, HostInstant::now());
        }
        let now = Instant::now();
        if now >= polled.due
            && let Some((handle, size)) = reading.handles.single()
        {
            if let Some(unanswered) = polled.open.take() {
                self.client.forget(unanswered);
            }
            let request = Request::Read {
                group: index::VALUE_BY_HANDLE,
                offset: handle,
                length: size,
            };
            polled.open = Some(self.client.send(&request, self.timeout)?);
            polled.due += polled.period;
            if polled.due < now {
                polled.due = now + polled.period;
            }
        }
        Ok(())
    }

    /// Gives everything back that the controller keeps for us.
    pub(super) fn close(mut self) {
        let limit = self.timeout;
        if let Some(handle) = self.read.as_ref().and_then(|read| read.notification) {
            let request = Request::DeleteNotification { handle };
            // The controller forgets it with the connection.
            let _ = self.client.call(&request, limit, |_| ());
        }
        let read = self.read.take().map(|read| read.handles);
        let write = self.write.take().map(|(_, handles)| handles);
        for handles in read.into_iter().chain(write) {
            handles.release(&mut self.client, limit);
        }
        self.client.close();
    }
}

fn version(client: &mut Client, limit: Duration) -> Result<Option<u8>, ClientError> {
    match client.read(index::SYMBOL_VERSION, 0, 1, limit) {
        Ok(version) => Ok(version.first().copied()),
        // Not every server has one.
        Err(ClientError::Refused(code)) if !code.may_pass() && code != Code::NO_MACHINE => Ok(None),
        Err(error) => Err(error),
    }
}

/// The variables as the controller has them.
pub(super) fn find_all(
    client: &mut Client,
    plan: &WritePlan,
    limit: Duration,
) -> Result<Vec<Variable>, VariableError> {
    let layouts = layouts(plan)?;
    let pairs = plan.symbols.iter().zip(layouts);
    let found = pairs.map(|(wanted, layout)| {
        let (symbol, variable) = variables::find(client, &wanted.name, layout.as_ref(), limit)?;
        if symbol.is_read_only() {
            return Err(VariableError::ReadOnly { name: symbol.name });
        }
        Ok(variable)
    });
    found.collect()
}

/// The layout given, for each of the variables: all of it for one, a scalar for each of several.
pub(super) fn layouts(plan: &WritePlan) -> Result<Vec<Option<Layout>>, LayoutError> {
    match (&plan.layout.layout, plan.symbols.len()) {
        (None, count) => Ok(vec![None; count]),
        (Some(layout), 1) => Ok(vec![Some(layout.clone())]),
        (Some(layout), count) if layout.slots.len() == count => Ok(layout
            .slots
            .iter()
            .map(|slot| Some(Layout::of_scalars(slot.scalar, 1)))
            .collect()),
        (Some(layout), count) => Err(LayoutError(format!(
            "--layout has {} types for {count} variables",
            layout.slots.len()
        ))),
    }
}

/// Pairs variables and fields.
pub(super) fn plan_image(plan: &WritePlan, found: &[Variable]) -> Result<Image, LayoutError> {
    let fields = plan
        .layout
        .fields
        .as_ref()
        .map(|fields| fields.0.as_slice());
    let missing = plan.layout.missing;
    Image::plan(&plan.symbols, found, fields, &usual(), missing)
}

fn ready_to_write(
    client: &mut Client,
    plan: &WritePlan,
    older: Option<&Image>,
    limit: Duration,
) -> Result<(Image, Handles), VariableError> {
    let found = find_all(client, plan, limit)?;
    let mut image = plan_image(plan, &found)?;
    if let Some(older) = older {
        image.follow(older);
    }
    let handles = Handles::get(client, &image, limit)?;
    Ok((image, handles))
}

fn ready_to_read(
    client: &mut Client,
    plan: &ReadPlan,
    limit: Duration,
) -> Result<Reading, VariableError> {
    let layout = plan.layout.as_ref();
    let (_, variable) = variables::find(client, &plan.symbol, layout, limit)?;
    let wanted = Wanted {
        name: plan.symbol.clone(),
        field: None,
    };
    let fields = plan.fields.as_ref().map(|fields| fields.0.as_slice());
    let image = Image::plan(&[wanted], &[variable], fields, &usual_read(), Missing::Hold)?;
    let handles = Handles::get(client, &image, limit)?;
    let mut reading = Reading {
        image,
        handles,
        notification: None,
        polled: None,
    };
    if plan.polled {
        reading.polled = Some(Polled {
            period: plan.period,
            due: Instant::now(),
            open: None,
        });
    } else if let Some((handle, size)) = reading.handles.single() {
        let ticks = u32::try_from(plan.period.as_nanos() / 100).unwrap_or(u32::MAX);
        let request = Request::AddNotification {
            group: index::VALUE_BY_HANDLE,
            offset: handle,
            length: size,
            mode: Transmission::Cyclic,
            max_delay: 0,
            cycle: ticks,
        };
        let number = |payload: &[u8]| payload.first_chunk().copied().map(u32::from_le_bytes);
        let given = client.call(&request, limit, number)?;
        reading.notification = given;
    }
    Ok(reading)
}
