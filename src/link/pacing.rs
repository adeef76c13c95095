//! When a simulated device is due to speak.

use std::time::{Duration, Instant};

/// Maps simulated time to the host's: as it is, `speed` times faster, or as fast as can be.
#[derive(Clone, Copy, Debug)]
pub struct Pacing {
    start: Instant,
    /// Simulated seconds a second; none is as fast as can be.
    speed: Option<f64>,
}

/// The longest sleep between two looks at whether to stop.
const NAP: Duration = Duration::from_millis(20);

impl Pacing {
    /// Simulated time 0 is now. `speed` none: nothing is ever waited for.
    pub fn new(speed: Option<f64>) -> Pacing {
        Pacing {
            start: Instant::now(),
            speed,
        }
    }

    /// When the simulated instant `t_s` is due on the host's monotonic clock; none: at once.
    pub fn due(&self, t_s: f64) -> Option<Instant> {
        let seconds = (t_s / self.speed?).max(0.0);
        Some(self.start + Duration::try_from_secs_f64(seconds).ok()?)
    }

    /// Simulated time now, s; none where nothing is waited for.
    pub fn now_s(&self) -> Option<f64> {
        Some(self.start.elapsed().as_secs_f64() * self.speed?)
    }

    /// Sleeps until `t_s` is due or `stopped` says so; whether it came due.
    pub fn wait(&self, t_s: f64, mut stopped: impl FnMut() -> bool) -> bool {
        let Some(due) = self.due(t_s) else {
            return !stopped();
        };
        loop {
            let left = due.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return true;
            }
            if stopped() {
                return false;
            }
            std::thread::sleep(left.min(NAP));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn simulated_time_may_run_faster() {
        let pacing = Pacing::new(Some(10.0));
        let due = pacing.due(5.0).unwrap() - pacing.due(0.0).unwrap();
        assert_eq!(due, Duration::from_millis(500));
        assert!(pacing.wait(0.1, || false));
        assert!(pacing.now_s().unwrap() >= 0.1);
        assert!(!pacing.wait(1e6, || true));
        assert!(Pacing::new(None).wait(1e9, || false));
    }
}
