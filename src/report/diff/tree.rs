//! JSON against JSON: value by value, each met by its path.

use super::{Comparison, DiffError, Rules};
use serde_json::Value;
use std::collections::BTreeMap;

/// Compares two texts. A value's name for tolerances is its path, `runs.0.x.rms_mm`, or the last part
/// of it, `rms_mm`.
///
/// # Errors
/// A text that is no JSON, a rule for a value that neither has.
pub fn compare(
    a: &[u8],
    b: &[u8],
    names: [&str; 2],
    rules: &Rules,
) -> Result<Comparison, DiffError> {
    let mut comparison = Comparison::new(names, rules);
    let parse = |text: &[u8], name: &str| -> Result<Value, DiffError> {
        serde_json::from_slice(text)
            .map_err(|error| DiffError::Bad(format!("{name}: not JSON: {error}")))
    };
    let [name_a, name_b] = names;
    let (mut left, mut right) = (BTreeMap::new(), BTreeMap::new());
    leaves(&parse(a, name_a)?, String::new(), &mut left);
    leaves(&parse(b, name_b)?, String::new(), &mut right);
    for (path, value) in &left {
        let Some(column) = comparison.column(path) else {
            continue;
        };
        match right.get(path) {
            Some(other) => {
                comparison.begin_row();
                comparison.field(column, &String::new, value.as_bytes(), other.as_bytes());
            }
            None => comparison.only_in(0, &format!("{path}, {value}")),
        }
    }
    for (path, value) in &right {
        if !left.contains_key(path) && comparison.column(path).is_some() {
            comparison.only_in(1, &format!("{path}, {value}"));
        }
    }
    comparison.check_rules()?;
    if rules.are_exact() && comparison.is_equal() && a != b {
        comparison.remark(
            "the values are equal, the bytes are not: the order of names, or blanks".to_owned(),
        );
    }
    Ok(comparison)
}

/// All values of a tree that are no list and no object, and the empty ones of those.
fn leaves(value: &Value, path: String, out: &mut BTreeMap<String, String>) {
    let below = |part: &str| match path.as_str() {
        "" => part.to_owned(),
        path => format!("{path}.{part}"),
    };
    match value {
        Value::Array(items) if !items.is_empty() => {
            for (i, item) in items.iter().enumerate() {
                leaves(item, below(&i.to_string()), out);
            }
        }
        Value::Object(fields) if !fields.is_empty() => {
            for (name, item) in fields {
                leaves(item, below(name), out);
            }
        }
        leaf => {
            out.insert(path, leaf.to_string());
        }
    }
}
