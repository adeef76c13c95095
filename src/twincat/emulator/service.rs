//! A PLC on a socket.

use super::Plc;
use crate::link::emulation::{Conditions, Device, Emulation, LineId, Outbox};
use crate::link::{HostInstant, LinkError};
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A PLC with several owners.
#[derive(Clone, Debug, Default)]
pub struct SharedPlc(Arc<Mutex<Plc>>);

impl SharedPlc {
    /// Puts a PLC where several can have it.
    pub fn new(plc: Plc) -> SharedPlc {
        SharedPlc(Arc::new(Mutex::new(plc)))
    }

    /// The PLC, for as long as the guard lives; nobody is answered meanwhile.
    pub fn lock(&self) -> MutexGuard<'_, Plc> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until `done` says so of the PLC, at most `limit`; whether it did.
    pub fn wait_until(&self, limit: Duration, mut done: impl FnMut(&Plc) -> bool) -> bool {
        let due = Instant::now() + limit;
        loop {
            if done(&self.lock()) {
                return true;
            }
            if Instant::now() >= due {
                return false;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}

impl Device for SharedPlc {
    fn connected(&mut self, line: LineId, _service: usize, _now_ns: i64) {
        self.lock().connected(line);
    }

    fn disconnected(&mut self, line: LineId) {
        self.lock().disconnected(line);
    }

    fn input(&mut self, line: LineId, bytes: &[u8], now_ns: i64, out: &mut Outbox) {
        let mut plc = self.lock();
        for older in plc.ended_by(line) {
            out.close(older);
        }
        plc.input(line, bytes, now_ns, out);
    }

    fn advance(&mut self, now_ns: i64, out: &mut Outbox) {
        self.lock().advance(now_ns, HostInstant::now().utc, out);
    }

    fn due_ns(&self) -> Option<i64> {
        self.lock().due_ns()
    }
}

/// A PLC that is served by a thread until this is dropped.
#[derive(Debug)]
pub struct Service {
    address: SocketAddr,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Service {
    /// Serves a PLC at an address; port 0 is any.
    ///
    /// # Errors
    /// [`LinkError`] where the address is not to be had.
    pub fn start(
        plc: &SharedPlc,
        address: SocketAddr,
        conditions: Conditions,
    ) -> Result<Service, LinkError> {
        let conditions = Conditions {
            speed: conditions.speed.or(Some(1.0)),
            ..conditions
        };
        let mut emulation = Emulation::new(conditions);
        let address = emulation.listen(address)?;
        let stop = Arc::new(AtomicBool::new(false));
        let (asked, mut device) = (Arc::clone(&stop), plc.clone());
        let thread = std::thread::spawn(move || {
            // Where the host fails the clients see the connection end.
            let _ = emulation.run(&mut device, || asked.load(Ordering::Relaxed));
        });
        Ok(Service {
            address,
            stop,
            thread: Some(thread),
        })
    }

    /// Where it is served.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// What a client is to be given as its target.
    pub fn target(&self, plc: &SharedPlc) -> String {
        let plc = plc.lock();
        format!("{}/{}:{}", self.address, plc.net_id, plc.port)
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A thread that has fallen over has nothing more to end.
            let _ = thread.join();
        }
    }
}
