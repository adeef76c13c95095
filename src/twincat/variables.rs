//! Variables found by name, written and read by handle.
//!
//! One request writes everything: a PLC works off a request within one cycle, two may straddle one.

use super::address::AmsAddress;
use super::ams::{Request, index};
use super::bytes::{Bytes, length_u32, zero_ended};
use super::client::{Client, ClientError};
use super::code::Code;
use super::image::{Image, Variable};
use super::layout::{Layout, LayoutError, Scalar};
use super::symbols::{self, Symbol};
use std::time::Duration;

/// Why a variable cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum VariableError {
    /// The controller has none of that name.
    #[error(
        "{name}: there is no such symbol. `ads-push list` shows those that there are; mind that the \
         program must be loaded, and that names hold no index of an array"
    )]
    NotFound {
        /// The name asked for.
        name: String,
    },
    /// The controller does not let it be written to.
    #[error("{name}: the controller does not let it be written to")]
    ReadOnly {
        /// Its name.
        name: String,
    },
    /// It is not as it must be.
    #[error(transparent)]
    Layout(#[from] LayoutError),
    /// The controller could not be asked.
    #[error(transparent)]
    Client(#[from] ClientError),
}

/// Asks for a variable's type and size. With `layout` given, only the size is compared.
///
/// # Errors
/// [`VariableError`].
pub fn find(
    client: &mut Client,
    name: &str,
    layout: Option<&Layout>,
    timeout: Duration,
) -> Result<(Symbol, Variable), VariableError> {
    let symbol = symbols::find(client, name, timeout).map_err(|error| match error.code() {
        Some(Code::NO_SYMBOL) => VariableError::NotFound {
            name: name.to_owned(),
        },
        _ => VariableError::Client(error),
    })?;
    let layout = match layout {
        Some(layout) if layout.size == symbol.size as usize => layout.clone(),
        Some(layout) => {
            return Err(LayoutError(format!(
                "{name} is {} ({} bytes)\nthe layout given is {layout}\nNothing was written",
                symbol.type_name, symbol.size
            ))
            .into());
        }
        // Only the size is known: it can be LREALs.
        None if symbol.type_name.is_empty() && symbol.size.is_multiple_of(8) => {
            Layout::of_scalars(Scalar::F64, symbol.size as usize / 8)
        }
        None if symbol.type_name.is_empty() => {
            return Err(LayoutError(format!(
                "{name} has {} bytes, and the controller does not tell its type: give --layout",
                symbol.size
            ))
            .into());
        }
        None => {
            let look_up = |name: &str| -> Result<_, VariableError> {
                Ok(symbols::data_type(client, name, timeout)?)
            };
            Layout::of_symbol(&symbol, look_up).map_err(|error| match error {
                VariableError::Layout(LayoutError(why)) => {
                    VariableError::Layout(LayoutError(format!("{name}: {why}")))
                }
                other => other,
            })?
        }
    };
    let variable = Variable {
        name: name.to_owned(),
        type_name: symbol.type_name.clone(),
        layout,
    };
    Ok((symbol, variable))
}

/// The handles of an image's variables.
#[derive(Clone, Debug, Default)]
pub struct Handles {
    /// Handle and size, bytes.
    parts: Vec<(u32, u32)>,
    /// The request for several variables, to use again.
    sum: Vec<u8>,
}

impl Handles {
    /// Asks for the handles.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn get(
        client: &mut Client,
        image: &Image,
        timeout: Duration,
    ) -> Result<Handles, ClientError> {
        let mut handles = Handles::default();
        for (name, size) in image.parts() {
            let asked = zero_ended(name);
            let reply = client.read_write(index::HANDLE_BY_NAME, 0, 4, &asked, timeout)?;
            let handle = Bytes(&reply).u32();
            let handle = handle.ok_or(ClientError::Reply("the question for a handle"))?;
            handles.parts.push((handle, length_u32(size)));
        }
        Ok(handles)
    }

    /// The one handle and its size, where there is one.
    pub fn single(&self) -> Option<(u32, u32)> {
        match self.parts.as_slice() {
            [one] => Some(*one),
            _ => None,
        }
    }

    /// Writes the bytes of all variables in one request.
    ///
    /// # Errors
    /// [`ClientError`]; of several variables the first that was refused says why.
    pub fn write(
        &mut self,
        client: &mut Client,
        bytes: &[u8],
        timeout: Duration,
    ) -> Result<(), ClientError> {
        if let Some((handle, _)) = self.single() {
            return client.write(index::VALUE_BY_HANDLE, handle, bytes, timeout);
        }
        let request = self.sum_write(bytes);
        let refused = client.call(&request, timeout, |payload| {
            let mut reply = Bytes(payload);
            let length = reply.u32()?;
            let mut codes = (0..length / 4).map(|_| reply.u32().map(Code));
            let first = codes.by_ref().find(|code| *code != Some(Code::OK));
            Some((length, first))
        })?;
        match refused {
            Some((_, Some(Some(code)))) => Err(ClientError::Refused(code)),
            Some((length, None)) if length as usize == 4 * self.parts.len() => Ok(()),
            _ => Err(ClientError::Reply("a write of several variables")),
        }
    }

    fn sum_write(&mut self, bytes: &[u8]) -> Request<'_> {
        self.sum.clear();
        for (handle, size) in &self.parts {
            for number in [index::VALUE_BY_HANDLE, *handle, *size] {
                self.sum.extend_from_slice(&number.to_le_bytes());
            }
        }
        self.sum.extend_from_slice(bytes);
        Request::ReadWrite {
            group: index::SUM_WRITE,
            offset: length_u32(self.parts.len()),
            length: length_u32(4 * self.parts.len()),
            data: &self.sum,
        }
    }

    /// The request that [`Handles::write`] would send, with handles that stand for those the
    /// controller would give; for a look at the bytes.
    pub fn rehearse(
        image: &Image,
        bytes: &[u8],
        target: AmsAddress,
        source: AmsAddress,
        out: &mut Vec<u8>,
    ) {
        let mut handles = Handles::default();
        for (number, (_, size)) in image.parts().enumerate() {
            let handle = 0xA000_0001 + length_u32(number);
            handles.parts.push((handle, length_u32(size)));
        }
        let request = match handles.single() {
            Some((handle, _)) => Request::Write {
                group: index::VALUE_BY_HANDLE,
                offset: handle,
                data: bytes,
            },
            None => handles.sum_write(bytes),
        };
        request.frame(out, target, source, 1);
    }

    /// Gives the handles back, without waiting for what the controller says to that.
    pub fn release(&self, client: &mut Client, timeout: Duration) {
        for (handle, _) in &self.parts {
            let request = Request::Write {
                group: index::RELEASE_HANDLE,
                offset: 0,
                data: &handle.to_le_bytes(),
            };
            // It forgets them by itself once the connection ends.
            let _ = client.call(&request, timeout, |_| ());
        }
    }
}
