//! Why a session failed.

use super::request::{Refusal, Request};
use crate::link::LinkError;
use crate::sick::scandata::FieldError;

/// Why a session is of no use (any more), or a request failed.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The line failed.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// Neither dialect was answered.
    #[error("{place}: no answer in CoLa A or CoLa B in {waited_s:.1} s ({heard}). {advice}")]
    NoDialect {
        /// Host and port, or the serial port.
        place: String,
        /// How long was waited, s.
        waited_s: f64,
        /// What came instead.
        heard: String,
        /// What to try.
        advice: &'static str,
    },
    /// A request was not answered.
    #[error("{place}: {request:?} was not answered in {waited_s:.1} s")]
    Silent {
        /// Host and port, or the serial port.
        place: String,
        /// The request, as CoLa A writes it.
        request: String,
        /// How long was waited, s.
        waited_s: f64,
    },
    /// The device refused a request.
    #[error("{request}: {refusal}")]
    Refused {
        /// The request, as CoLa A writes it.
        request: String,
        /// Why.
        refusal: Refusal,
    },
    /// A method was carried out but says that it failed.
    #[error("{request}: the device answers {status}: {meaning}")]
    Failed {
        /// The request, as CoLa A writes it.
        request: String,
        /// What the device answered.
        status: u8,
        /// What that means and what to do.
        meaning: String,
    },
    /// An answer does not hold what it should.
    #[error("answer to {request:?}: {error}")]
    Answer {
        /// The request, as CoLa A writes it.
        request: String,
        /// What is wrong.
        error: FieldError,
    },
    /// The user wants it to end.
    #[error("ended on request")]
    Interrupted,
}

impl ClientError {
    /// The answer to `request` does not hold what it should.
    pub(super) fn answer(request: &Request, error: FieldError) -> ClientError {
        ClientError::Answer {
            request: request.to_string(),
            error,
        }
    }
}
