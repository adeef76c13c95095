//! The hash of a scanner's password: from a file, from the environment, or that of delivery.

use crate::sick::client::commands::DELIVERED_HASH;
use crate::stream::Fault;
use std::env::{self, VarError};
use std::path::Path;

/// The environment's variable with the hash.
const VARIABLE: &str = "CABLEPOSE_PASSWORD";

/// The hash to log in with.
///
/// # Errors
/// A file that cannot be read (66), or a text that is no hash (78).
pub(super) fn hash(file: Option<&Path>) -> Result<u32, Fault> {
    if let Some(path) = file {
        let name = path.display().to_string();
        let text = std::fs::read_to_string(path)
            .map_err(|error| Fault::NoInput(format!("{name}: {error}")))?;
        return parse(&text, &name);
    }
    match env::var(VARIABLE) {
        Ok(text) => parse(&text, VARIABLE),
        Err(VarError::NotPresent) => Ok(DELIVERED_HASH),
        Err(VarError::NotUnicode(_)) => parse("", VARIABLE),
    }
}

fn parse(text: &str, source: &str) -> Result<u32, Fault> {
    let digits = text.trim();
    let is_hash = digits.len() == 8 && digits.bytes().all(|byte| byte.is_ascii_hexdigit());
    let hash = u32::from_str_radix(digits, 16).ok();
    hash.filter(|_| is_hash).ok_or_else(|| {
        Fault::Configuration(format!(
            "{source}: the password's hash is wanted, 8 hexadecimal digits such as F4724744"
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hash_has_eight_digits() {
        let path = env::temp_dir().join(format!("cablepose-hash-{}", std::process::id()));
        for (text, found) in [
            ("F4724744\n", Some(DELIVERED_HASH)),
            ("secret", None),
            ("+F472474", None),
            ("1234", None),
            ("", None),
        ] {
            std::fs::write(&path, text).unwrap();
            match hash(Some(&path)) {
                Ok(hash) => assert_eq!(Some(hash), found, "{text}"),
                Err(fault) => assert_eq!((found, fault.status()), (None, 78), "{fault}"),
            }
        }
        std::fs::remove_file(&path).unwrap();
        assert_eq!(hash(Some(&path)).unwrap_err().status(), 66);
    }
}
