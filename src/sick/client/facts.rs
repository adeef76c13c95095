//! Everything that a device tells of itself, for people and programs.

use super::commands::{Contamination, DeviceStatus};
use super::configure::Present;
use super::error::ClientError;
use super::request::{Reply, Request};
use super::session::Client;
use crate::sick::cola::Dialect;
use crate::sick::scandata::FieldError;
use serde_json::{Value, json};

/// One thing that is known of a device.
#[derive(Clone, Debug, PartialEq)]
pub struct Fact {
    /// What, with its unit.
    pub key: &'static str,
    /// Its value.
    pub value: Value,
}

impl Fact {
    /// The value for people.
    pub fn text(&self) -> String {
        match &self.value {
            Value::String(text) => text.clone(),
            other => other.to_string(),
        }
    }
}

type Parse = fn(&Reply) -> Result<Value, FieldError>;
/// A fact's key, the variable that has it, and how its answer is read.
type Variable = (&'static str, &'static str, Parse);

/// Variables of which each is a fact by itself.
const VARIABLES: [Variable; 11] = [
    ("device", "DeviceIdent", |reply| {
        let mut values = reply.values();
        let text = [values.text("name")?, values.text("version")?].join(" ");
        Ok(json!(text.trim()))
    }),
    ("type", "DItype", text),
    ("order_number", "DIornr", text),
    ("serial_number", "SerialNumber", text),
    ("firmware", "FirmwareVersion", text),
    ("location", "LocationName", text),
    ("operating_h", "ODoprh", |reply| {
        Ok(json!(f64::from(reply.values().u32("hours")?) / 10.0))
    }),
    ("power_ons", "ODpwrc", |reply| {
        Ok(json!(reply.values().u32("power-on count")?))
    }),
    ("temperature_c", "OPcurtmpdev", |reply| {
        Ok(json!(reply.values().real("temperature")?))
    }),
    ("contamination", "LCMstate", |reply| {
        Contamination::parse(reply).map(|state| json!(state.to_string()))
    }),
    ("device_state", "SCdevicestate", |reply| {
        Ok(json!(match reply.values().u8("state")? {
            0 => "busy or logged in",
            1 => "ready",
            2 => "error",
            3 => "standby",
            _ => "not documented",
        }))
    }),
];

/// The time client, where a firmware has one.
const TIME_CLIENT: [Variable; 4] = [
    ("ntp_role", "TSCRole", |reply| {
        Ok(json!(match reply.values().u8("role")? {
            0 => "off",
            1 => "client",
            2 => "server",
            _ => "not documented",
        }))
    }),
    ("ntp_server", "TSCTCSrvAddr", |reply| {
        let mut values = reply.values();
        let mut parts = Vec::new();
        for _ in 0..4 {
            parts.push(values.u8("address")?.to_string());
        }
        Ok(json!(parts.join(".")))
    }),
    ("ntp_max_offset_s", "TSCTCmaxoffset", |reply| {
        Ok(json!(reply.values().real("offset")?))
    }),
    ("ntp_delay_s", "TSCTCdelay", |reply| {
        Ok(json!(reply.values().real("delay")?))
    }),
];

fn text(reply: &Reply) -> Result<Value, FieldError> {
    reply.values().text("text").map(|text| json!(text))
}

/// Asks for everything; what the firmware does not know is left out.
pub fn facts(client: &mut Client) -> Result<Vec<Fact>, ClientError> {
    let mut facts = vec![
        Fact {
            key: "place",
            value: json!(client.place()),
        },
        Fact {
            key: "dialect",
            value: json!(match client.dialect() {
                Dialect::Text => "CoLa A",
                Dialect::Binary => "CoLa B",
            }),
        },
    ];
    for variable in VARIABLES {
        facts.extend(ask(client, variable)?);
    }
    if let Some(status) = client.ask_if_known(&DeviceStatus::request(), DeviceStatus::parse)? {
        let state = format!("{} ({})", status.words(), status.state);
        for (key, value) in [
            ("state", json!(state)),
            ("temperature_out_of_range", json!(status.too_hot_or_cold)),
            ("clock", json!(format!("{} {}", status.date, status.time))),
        ] {
            facts.push(Fact { key, value });
        }
    }
    configuration(&Present::read(client)?, &mut facts);
    for variable in TIME_CLIENT {
        facts.extend(ask(client, variable)?);
    }
    Ok(facts)
}

/// Asks for the one fact of this key; none where the firmware does not know it. A key that is no
/// variable's is a fault of the caller: debug builds, and so the tests, end there.
///
/// # Errors
/// What the session runs into.
pub fn fact(client: &mut Client, key: &str) -> Result<Option<Fact>, ClientError> {
    let mut variables = VARIABLES.into_iter().chain(TIME_CLIENT);
    let variable = variables.find(|(known, ..)| *known == key);
    debug_assert!(variable.is_some(), "{key} is no variable's key");
    match variable {
        Some(variable) => ask(client, variable),
        None => Ok(None),
    }
}

/// None where the firmware does not know it.
fn ask(client: &mut Client, (key, name, parse): Variable) -> Result<Option<Fact>, ClientError> {
    let value = client.ask_if_known(&Request::read(name), parse)?;
    Ok(value.map(|value| Fact { key, value }))
}

fn configuration(present: &Present, facts: &mut Vec<Fact>) {
    let mut push = |key, value| facts.push(Fact { key, value });
    let degrees = |angle: i32| f64::from(angle) / 1e4;
    if let Some(scan) = present.scan {
        push("frequency_hz", json!(f64::from(scan.frequency) / 100.0));
        push("resolution_deg", json!(f64::from(scan.resolution) / 1e4));
        push(
            "aperture_deg",
            json!([degrees(scan.start), degrees(scan.end)]),
        );
    }
    if let Some(range) = present.range {
        push(
            "range_deg",
            json!([degrees(range.start), degrees(range.end)]),
        );
    }
    if let Some(echoes) = present.echoes {
        push("echoes", json!(echoes.to_string()));
    }
    if let Some(contents) = present.contents {
        push("remission", json!(contents.remission));
        push("time", json!(contents.time));
        push("encoder", json!(contents.encoder[0] > 0));
        push("divider", json!(contents.every));
    }
    if let Some(mean) = present.mean {
        push("mean_scans", json!(mean.divisor()));
    }
    if let Some(particle) = present.particle {
        push("particle_filter", json!(particle.on));
    }
}
