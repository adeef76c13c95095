//! What is asked of a controller, or of nobody, without pushing: checks, lists, a route, the bytes.

use super::TOOL;
use super::args::{LayoutArgs, LinkArgs, RouteArgs, usual};
use super::session::{Link, Setback, WritePlan, find_all, layouts, plan_image, told};
use crate::link::{Datagrams, HostInstant};
use crate::record::Pose;
use crate::stream::{Fault, Input, Options, Outcome};
use crate::twincat::fields::Sample;
use crate::twincat::image::{Variable, Wanted};
use crate::twincat::layout::{Layout, LayoutError, Scalar};
use crate::twincat::route::{Credentials, Route};
use crate::twincat::symbols;
use crate::twincat::variables::{Handles, VariableError};
use crate::twincat::{AmsAddress, Client, LocalAddress, NetId, Target};
use std::io::{self, Write as _};
use std::time::Duration;

/// Look up the variables, compare them with the fields, write nothing
#[derive(Debug, clap::Parser)]
pub(super) struct CheckArgs {
    /// The controller
    #[arg(value_name = "TARGET")]
    target: Target,
    /// Variables, as they would be pushed to
    #[arg(value_name = "SYMBOL", required = true)]
    symbols: Vec<Wanted>,
    #[command(flatten)]
    layout: LayoutArgs,
    #[command(flatten)]
    link: LinkArgs,
}

/// List the controller's variables: name, type, bytes, comment
#[derive(Debug, clap::Parser)]
pub(super) struct ListArgs {
    /// The controller
    #[arg(value_name = "TARGET")]
    target: Target,
    /// Only those whose names fit: * is any letters, ? one; capital letters are as small ones
    #[arg(value_name = "GLOB", default_value = "*")]
    glob: String,
    #[command(flatten)]
    link: LinkArgs,
}

/// At least so long, for questions that nobody waits for in a loop.
const PATIENT: Duration = Duration::from_secs(2);

fn connect(target: &Target, args: &LinkArgs) -> anyhow::Result<(Link, Client)> {
    args.check()?;
    let link = Link {
        target: target.clone(),
        local: args.local(),
        timeout: args.timeout.max(PATIENT),
    };
    let client = Client::connect(&link.target, link.local, link.timeout)
        .map_err(|error| Fault::Unavailable(told(&error, &link, None)))?;
    Ok((link, client))
}

fn fault(error: VariableError, link: &Link, client: &Client) -> Fault {
    Setback::of(&error, link, Some(client)).fault()
}

/// Prints what would be written where.
pub(super) fn check(args: CheckArgs) -> anyhow::Result<Outcome> {
    let (link, mut client) = connect(&args.target, &args.link)?;
    let plan = WritePlan {
        symbols: args.symbols,
        layout: args.layout,
    };
    let ask = |client: &mut Client| -> Result<String, VariableError> {
        let state = client.state(link.timeout)?;
        let name = client.device_info(link.timeout)?;
        let found = find_all(client, &plan, link.timeout)?;
        let image = plan_image(&plan, &found)?;
        let mut text = format!("{} at {}, {}\n", name, client.target(), state.name());
        for variable in &found {
            let Variable {
                name,
                type_name,
                layout,
            } = variable;
            text.push_str(&format!("{name}: {type_name}: {layout}\n"));
        }
        text.push_str(&image.describe(None));
        Ok(text)
    };
    let text = ask(&mut client).map_err(|error| fault(error, &link, &client))?;
    client.close();
    io::stdout().write_all(text.as_bytes())?;
    Ok(Outcome::Done)
}

/// Prints the variables there are.
pub(super) fn list(args: &ListArgs) -> anyhow::Result<Outcome> {
    let (link, mut client) = connect(&args.target, &args.link)?;
    let mut all = symbols::all(&mut client, link.timeout)
        .map_err(|error| Fault::Unavailable(told(&error, &link, Some(&client))))?;
    client.close();
    let glob = args.glob.to_lowercase();
    all.retain(|symbol| fits(glob.as_bytes(), symbol.name.to_lowercase().as_bytes()));
    all.sort_by(|a, b| a.name.cmp(&b.name));
    let mut text = String::new();
    for symbol in all {
        let access = if symbol.is_read_only() {
            " (read-only)"
        } else {
            ""
        };
        text.push_str(&format!(
            "{}\t{}{access}\t{}\t{}\n",
            symbol.name, symbol.type_name, symbol.size, symbol.comment
        ));
    }
    io::stdout().write_all(text.as_bytes())?;
    Ok(Outcome::Done)
}

/// Whether a name fits a pattern with * and ?.
fn fits(pattern: &[u8], name: &[u8]) -> bool {
    let (mut p, mut n) = (0, 0);
    // Where the last * was, and how far it reaches.
    let mut star: Option<(usize, usize)> = None;
    while n < name.len() {
        match pattern.get(p) {
            Some(b'*') => {
                star = Some((p, n));
                p += 1;
            }
            Some(letter) if *letter == b'?' || Some(letter) == name.get(n) => {
                p += 1;
                n += 1;
            }
            _ => match star {
                Some((at, reach)) => {
                    star = Some((at, reach + 1));
                    p = at + 1;
                    n = reach + 1;
                }
                None => return false,
            },
        }
    }
    let rest = pattern.get(p..).unwrap_or_default();
    rest.iter().all(|letter| *letter == b'*')
}

/// Asks the controller for a route to this host.
pub(super) fn add_route(target: &Target, link: &LinkArgs, args: &RouteArgs) -> anyhow::Result<()> {
    let who = credentials(args)?;
    let line = Datagrams::open(&target.host, args.route_port)
        .map_err(|error| Fault::Unavailable(error.to_string()))?;
    let address = line.local_address();
    let net_id = match link.local() {
        LocalAddress::NetId(net_id) => Some(net_id),
        LocalAddress::Router => {
            let text = "--add-route: a router on this host has routes of its own; add one there";
            return Err(Fault::Usage(text.into()).into());
        }
        LocalAddress::Usual => NetId::of_host(address),
    };
    let net_id = net_id.ok_or_else(|| {
        Fault::Usage("--add-route: this host has no IPv4 address there: give --local-net-id".into())
    })?;
    let host = args
        .route_host
        .clone()
        .unwrap_or_else(|| address.to_string());
    let name = args.route_name.clone();
    let route = Route {
        name: name.unwrap_or_else(|| format!("cablepose-{host}")),
        net_id,
        host,
        temporary: args.route_temporary,
    };
    route
        .add(&line, &target.host, &who)
        .map_err(|error| Fault::Unavailable(error.to_string()))?;
    eprintln!(
        "{TOOL}: {}: has a route {} to NetId {net_id} now",
        target.host, route.name
    );
    Ok(())
}

fn credentials(args: &RouteArgs) -> anyhow::Result<Credentials> {
    if let Some(path) = &args.route_credentials {
        let name = path.display();
        let text = std::fs::read_to_string(path)
            .map_err(|error| Fault::NoInput(format!("{name}: {error}")))?;
        let parsed = Credentials::parse(&text);
        return parsed.map_err(|why| Fault::Configuration(format!("{name}: {why}")).into());
    }
    let variable = |name: &str| {
        std::env::var(name).map_err(|_| {
            Fault::Usage(format!(
                "--add-route: who may add it? Give --route-credentials FILE, or set {name}"
            ))
        })
    };
    Ok(Credentials {
        user: variable("CABLEPOSE_ADS_USER")?,
        password: variable("CABLEPOSE_ADS_PASSWORD")?,
    })
}

/// Prints the requests that poses would make.
pub(super) fn rehearse(
    target: &Target,
    plan: &WritePlan,
    options: &Options,
) -> anyhow::Result<Outcome> {
    let configuration = |error: LayoutError| Fault::Configuration(error.0);
    let fields = plan.layout.fields.as_ref();
    let count = fields.map_or_else(|| usual().len(), |fields| fields.0.len());
    let single = plan.symbols.len() == 1 && plan.symbols.iter().all(|w| w.field.is_none());
    let layouts = layouts(plan).map_err(configuration)?;
    let found: Vec<Variable> = plan
        .symbols
        .iter()
        .zip(layouts)
        .map(|(wanted, layout)| Variable {
            name: wanted.name.clone(),
            type_name: String::new(),
            layout: layout
                .unwrap_or_else(|| Layout::of_scalars(Scalar::F64, if single { count } else { 1 })),
        })
        .collect();
    let mut image = plan_image(plan, &found).map_err(configuration)?;
    let target = AmsAddress {
        net_id: target.net_id.unwrap_or_default(),
        port: target.port,
    };
    let mut out = io::BufWriter::new(io::stdout());
    let mut input: Input<Pose> = Input::open(None, options)?;
    let (mut counter, mut bytes, mut frame) = (0, Vec::new(), Vec::new());
    while let Some(pose) = input.next()? {
        counter += 1;
        let sample = Sample {
            pose,
            bits: 0,
            counter,
            now: HostInstant::now().utc,
        };
        image.fill(&sample, &mut bytes);
        frame.clear();
        Handles::rehearse(&image, &bytes, target, AmsAddress::default(), &mut frame);
        writeln!(
            out,
            "# pose {counter}, seq {}: {} bytes to {target}",
            pose.seq,
            frame.len()
        )?;
        for (line, bytes) in frame.chunks(16).enumerate() {
            let hex: Vec<String> = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
            writeln!(out, "{:06x} {}", 16 * line, hex.join(" "))?;
        }
        for line in image.describe(Some(&bytes)).lines() {
            writeln!(out, "# {line}")?;
        }
    }
    out.flush()?;
    Ok(Outcome::Done)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_fit_patterns() {
        for (pattern, name, fit) in [
            ("*", "", true),
            ("main.*", "main.sickvalue", true),
            ("main.*", "gvl.main.x", false),
            ("*sick*", "main.sickvalue", true),
            ("m??n.x", "main.x", true),
            ("m?n.x", "main.x", false),
            ("*a*a*b", "aaaaaaaaaaaaaaaaaaaaaac", false),
            ("x", "x", true),
            ("", "x", false),
        ] {
            assert_eq!(
                fits(pattern.as_bytes(), name.as_bytes()),
                fit,
                "{pattern} {name}"
            );
        }
    }
}
