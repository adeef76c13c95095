//! What `ads-push` takes on its command line.

use crate::stream::Fault;
use crate::tool::arguments::CommonArgs;
use crate::tool::values::parse_duration;
use crate::twincat::fields::{self, Field, parse_fields};
use crate::twincat::image::{Missing, Wanted};
use crate::twincat::layout::Layout;
use crate::twincat::{LocalAddress, NetId, Target};
use std::path::PathBuf;
use std::time::Duration;

/// Who the controller is and how it is reached.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Controller")]
pub(super) struct LinkArgs {
    /// This host's AMS NetId, or router: a TwinCAT router on this host gives one [default: this
    /// host's address with .1.1; router for a TARGET on 127.0.0.1]
    #[arg(long, value_name = "NETID", value_parser = parse_local)]
    pub local_net_id: Option<LocalAddress>,
    /// How long an answer is waited for
    #[arg(long, value_name = "TIME", default_value = "500ms", value_parser = parse_duration)]
    pub timeout: Duration,
}

impl LinkArgs {
    pub(super) fn local(&self) -> LocalAddress {
        self.local_net_id.unwrap_or_default()
    }

    /// What there is to check of it.
    pub(super) fn check(&self) -> anyhow::Result<()> {
        if self.timeout < Duration::from_millis(1) {
            return Err(Fault::Usage("--timeout: at least 1ms is wanted".into()).into());
        }
        Ok(())
    }
}

/// What is written where.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Variables")]
pub(super) struct LayoutArgs {
    /// Fields in the variable's order, [MEMBER=]FIELD[:UNIT] with commas between [default:
    /// x,y,z,roll,pitch,yaw,stamp,status,counter]
    #[arg(long, value_name = "FIELDS", value_parser = parse_list)]
    pub fields: Option<Fields>,
    /// Types in the variable's order, such as 9*LREAL or LREAL,UDINT,_4,LREAL (_4: 4 bytes left
    /// free) [default: what the controller says]
    #[arg(long, value_name = "TYPES")]
    pub layout: Option<Layout>,
    /// Written where a pose has no number: hold (the last one that there was), nan, or a number
    #[arg(long, value_name = "VALUE", default_value = "hold", value_parser = parse_missing, allow_hyphen_values = true)]
    pub missing: Missing,
}

/// Fields on the command line.
#[derive(Clone, Debug)]
pub(super) struct Fields(pub Vec<Field>);

/// Reading the desired motion.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Reading the desired motion")]
pub(super) struct ReadArgs {
    /// Read this variable as a trajectory; to stdout, or beside the push to --read-to
    #[arg(long, value_name = "SYMBOL")]
    pub read: Option<String>,
    /// Its fields, FIELD[:UNIT] or MEMBER=FIELD[:UNIT]; _ is not looked at [default:
    /// x,y,z,roll,pitch,yaw,vx,vy,vz]
    #[arg(long, value_name = "FIELDS", value_parser = parse_list, requires = "read")]
    pub read_fields: Option<Fields>,
    /// Its types, as in --layout
    #[arg(long, value_name = "TYPES", requires = "read")]
    pub read_layout: Option<Layout>,
    /// Where the trajectory goes beside a push: a file or a FIFO
    #[arg(long, value_name = "FILE", requires = "read")]
    pub read_to: Option<PathBuf>,
    /// How often it is sent by the controller
    #[arg(long, value_name = "TIME", default_value = "10ms", value_parser = parse_duration, requires = "read")]
    pub read_period: Duration,
    /// Ask for it that often in place of having it sent
    #[arg(long, value_name = "TIME", value_parser = parse_duration, requires = "read", conflicts_with = "read_period")]
    pub poll: Option<Duration>,
    /// Where a point's stamp comes from [default: mapped, if there is a field stamp; else arrival]
    #[arg(long, value_enum, value_name = "HOW", requires = "read")]
    pub read_time: Option<ReadTime>,
    /// End after so many points
    #[arg(short = 'n', long, value_name = "N", requires = "read")]
    pub count: Option<u64>,
}

/// Where a point's stamp comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum ReadTime {
    /// The field stamp, carried to this host's clock by the times of arrival (the shortest delay stays in it)
    Mapped,
    /// The time of the controller's notification, carried over in the same way
    Notified,
    /// The field stamp as it is: the controller's clock is set to UTC
    Plc,
    /// When it arrived here
    Arrival,
}

/// A route on the controller.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Route")]
pub(super) struct RouteArgs {
    /// First ask the controller for a route to this host; without SYMBOL that is all
    #[arg(long)]
    pub add_route: bool,
    /// File with the lines user = NAME and password = WORD [default: the environment's
    /// CABLEPOSE_ADS_USER and CABLEPOSE_ADS_PASSWORD]
    #[arg(long, value_name = "FILE", requires = "add_route")]
    pub route_credentials: Option<PathBuf>,
    /// This host's address, as the controller reaches it [default: that on the way there]
    #[arg(long, value_name = "ADDRESS", requires = "add_route")]
    pub route_host: Option<String>,
    /// The route's name [default: cablepose-ADDRESS]
    #[arg(long, value_name = "NAME", requires = "add_route")]
    pub route_name: Option<String>,
    /// The controller forgets the route when it restarts
    #[arg(long, requires = "add_route")]
    pub route_temporary: bool,
    /// UDP port of the controller's system service
    #[arg(long, value_name = "PORT", default_value_t = crate::twincat::route::UDP_PORT, requires = "add_route")]
    pub route_port: u16,
}

/// How poses are pushed.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Pushing")]
pub(super) struct PushArgs {
    /// Write every pose, in order: a slow or missing controller holds up the pipe
    #[arg(long)]
    pub every: bool,
    /// With no new pose for so long, write the last one with the stale bit, and again every TIME; 0s:
    /// never
    #[arg(long, value_name = "TIME", default_value = "500ms", value_parser = parse_duration)]
    pub stale: Duration,
    /// Without the controller for so long, end with status 69 (78 if the variable does not fit)
    /// [default: 10s for the first connection, afterwards as long as poses come]
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    pub wait: Option<Duration>,
    /// Pass poses on with a column pushed_ns, when the controller acknowledged each; every pose waits
    /// for that, at most --timeout
    #[arg(long)]
    pub stamp_push: bool,
    /// Print the requests for the poses on stdin, byte by byte, and connect to nobody
    #[arg(long)]
    pub dry_run: bool,
}

/// The command line without a subcommand.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct WholeArgs {
    /// The controller: NETID[:PORT], HOST[:PORT] or HOST[:TCP-PORT]/NETID[:PORT]; PORT is 851
    #[arg(value_name = "TARGET", required = true)]
    pub target: Option<Target>,
    /// Variables: one array or structure, or several scalars as SYMBOL=FIELD[:UNIT]
    #[arg(value_name = "SYMBOL")]
    pub symbols: Vec<Wanted>,
    #[command(flatten)]
    pub layout: LayoutArgs,
    #[command(flatten)]
    pub push: PushArgs,
    #[command(flatten)]
    pub link: LinkArgs,
    #[command(flatten)]
    pub read: ReadArgs,
    #[command(flatten)]
    pub route: RouteArgs,
    #[command(flatten)]
    pub common: CommonArgs,
}

fn parse_local(text: &str) -> Result<LocalAddress, String> {
    if text == "router" {
        return Ok(LocalAddress::Router);
    }
    let net_id = text.parse::<NetId>();
    net_id.map(LocalAddress::NetId).map_err(|e| e.to_string())
}

fn parse_list(text: &str) -> Result<Fields, String> {
    parse_fields(text).map(Fields).map_err(|e| e.to_string())
}

fn parse_missing(text: &str) -> Result<Missing, String> {
    match text {
        "hold" => Ok(Missing::Hold),
        "nan" => Ok(Missing::Fixed(f64::NAN)),
        _ => text
            .parse()
            .map(Missing::Fixed)
            .map_err(|_| "hold, nan or a number is wanted".to_owned()),
    }
}

/// The usual fields.
pub(super) fn usual() -> Vec<Field> {
    // The list is a constant and checked by a test.
    parse_fields(fields::USUAL).unwrap_or_default()
}

/// The fields that are read unless others are asked for.
pub(super) fn usual_read() -> Vec<Field> {
    parse_fields(fields::USUAL_READ).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_usual_fields_are_fields() {
        assert_eq!(usual().len(), 9);
        assert_eq!(usual_read().len(), 9);
        assert!(usual().iter().all(Field::is_writable));
        assert!(usual_read().iter().all(Field::is_readable));
    }

    #[test]
    fn missing_numbers_have_three_ways() {
        assert_eq!(parse_missing("hold"), Ok(Missing::Hold));
        assert_eq!(parse_missing("-1.5"), Ok(Missing::Fixed(-1.5)));
        assert!(matches!(parse_missing("nan"), Ok(Missing::Fixed(n)) if n.is_nan()));
        assert!(parse_missing("drop").is_err());
        assert_eq!(parse_local("router"), Ok(LocalAddress::Router));
        assert!(parse_local("10.0.0.1").is_err());
    }
}
